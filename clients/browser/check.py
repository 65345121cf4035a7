"""What a scientist does on the dashboard, done by a browser."""

from __future__ import annotations

import os
import re
import shutil
import time
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from playwright.sync_api import expect, sync_playwright

from service import STUDY, TOKEN, Service

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

# Machines of every speed: what is waited for comes, or the test ends here, ms.
PATIENCE = 120_000
BEGAN = time.monotonic()

# What each part of a study says once it has its data.
SAYS = {
    "Overview": "per second on average",
    "Surrogate": "samples of this share",
    "Dataset": "all 60 samples",
    "Optima": "at last out of trim",
    "Stroke": "The three angles",
}

# How many charts of a tab are still to be drawn; they are when in view, so the first is brought there.
UNDRAWN = """() => {
    const plots = [...document.querySelectorAll("#tab .plot")].filter((e) => e.checkVisibility() && !e.dataset.drawn);
    plots[0]?.scrollIntoView({ block: "center" });
    return plots.length + (document.querySelector("#tab")?.textContent.includes("Loading ...") ? 1 : 0);
}"""


def say(text: str) -> None:
    print(f"{time.monotonic() - BEGAN:6.1f} s  {text}", flush=True)


def shot(page: Page, name: str) -> None:
    if folder := os.environ.get("SHOTS"):
        page.screenshot(path=Path(folder) / f"{name}.png", full_page=True)


class Visitor:
    """A page, and everything it complained of or asked for."""

    def __init__(self, browser: Browser, url: str, **more: object) -> None:
        self.context = browser.new_context(**more)
        self.context.set_default_timeout(PATIENCE)
        self.page = self.context.new_page()
        self.errors: list[str] = []
        self.hosts: set[str] = set()
        self.page.on("console", lambda m: self.errors.append(m.text) if m.type == "error" else None)
        self.page.on("pageerror", lambda e: self.errors.append(str(e)))
        self.page.on("request", lambda r: self.hosts.add(urlsplit(r.url).netloc or "none"))
        self.page.goto(url)
        self.url = url

    def open(self, tab: str) -> None:
        """Open a part of the study, and wait until each chart in it is drawn."""
        self.page.get_by_role("link", name=tab, exact=True).click()
        expect(self.page.locator("#tab")).to_contain_text(SAYS[tab], timeout=PATIENCE)
        until, settled = time.monotonic() + PATIENCE / 1000, 0
        while settled < 3:
            assert time.monotonic() < until, f"{tab} is not drawn"
            self.page.wait_for_timeout(150)
            settled = settled + 1 if self.page.evaluate(UNDRAWN) == 0 else 0

    def is_content(self) -> None:
        """Check that nothing was complained of, and nobody else was asked."""
        assert not self.errors, self.errors
        assert self.hosts <= {urlsplit(self.url).netloc, "none"}, self.hosts


def submit(page: Page) -> None:
    expect(page.get_by_text("There is no study yet")).to_be_visible(timeout=PATIENCE)
    page.get_by_role("link", name="New study").first.click()
    area = page.get_by_label("The study")
    expect(area).to_have_value(re.compile("name = \"quick\""))
    area.fill(STUDY.replace("samples = 60", "samples = 3"))
    page.get_by_role("button", name="Check").click()
    fault = page.get_by_role("alert")
    expect(fault).to_contain_text("3 is outside 20 to 200000")
    fault.get_by_role("button", name="/sampling/samples").click()
    chosen = area.evaluate("(area) => area.value.slice(area.selectionStart, area.selectionEnd)")
    assert chosen.strip() == "samples = 3", chosen
    area.fill("name = ")
    page.get_by_role("button", name="Check").click()
    expect(fault).to_contain_text("line 1")


def watch(page: Page) -> None:
    """See the study through its stages without asking again."""
    expect(page.get_by_role("heading", name="browser", level=1)).to_be_visible()
    expect(page.locator("#live")).to_have_text("live")
    expect(page.locator(".rail li")).to_have_count(5)
    expect(page.locator(".state").first).to_have_text("succeeded", timeout=PATIENCE)


def look(visitor: Visitor) -> None:
    page = visitor.page
    expect(page.locator("#tab").get_by_role("columnheader", name="Jobs in hand")).to_be_visible()
    visitor.open("Overview")
    shot(page, "overview")
    visitor.open("Surrogate")
    expect(page.get_by_text("samples of this share")).to_be_visible()
    shot(page, "surrogate")
    visitor.open("Dataset")
    expect(page.get_by_text("all 60 samples")).to_be_visible()
    shot(page, "dataset")
    visitor.open("Optima")
    optima = page.locator("#tab")
    for text in ("simulated ± se", "P/L [W/N]", "paper", "KKT residual"):
        expect(optima).to_contain_text(text)
    page.get_by_role("button", name="Compute").click()
    expect(optima).to_contain_text(re.compile("Free, stroke plane is|knows no stroke in trim"))
    visitor.open("Optima")
    shot(page, "optima")


def play(visitor: Visitor) -> None:
    """Move a slider, and fly the stroke where this coordinator does that."""
    page = visitor.page
    visitor.open("Stroke")
    lift = page.locator("#tab .facts dd").first
    expect(lift).to_have_text(re.compile(r"[0-9]"))
    before = lift.inner_text()
    page.get_by_label("frequency, value", exact=True).fill("19.5")
    expect(lift).not_to_have_text(before)
    page.get_by_label("Time").fill("3")
    fly = page.get_by_role("button", name="Fly this stroke")
    if fly.is_visible():
        fly.click()
        expect(page.get_by_text("Means over")).to_be_visible(timeout=PATIENCE)
        expect(page.get_by_text("with the wake of stroke")).to_be_visible()
        visitor.open("Stroke")
    shot(page, "stroke")


def is_accessible(page: Page) -> None:
    unnamed = page.evaluate("""() => [...document.querySelectorAll("input, select, textarea, button, a, [role=img]")]
        .filter((e) => e.checkVisibility() && (e.matches(".plot") || !e.closest(".plot")))
        .filter((e) => !(e.getAttribute("aria-label") || e.labels?.length || e.textContent.trim()))
        .map((e) => e.outerHTML.slice(0, 120))""")
    assert not unnamed, unnamed
    low = page.evaluate("""() => {
        const of = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
        const light = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255)
            .map((v) => (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
            .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
        const pairs = ["ink", "soft", "accent", "good", "bad", "warn"].flatMap((c) => [[c, "paper"], [c, "ground"]]);
        pairs.push(["accent-ink", "accent"]);
        return pairs.map(([a, b]) => [a, b, ...[of(a), of(b)].map(light).sort((x, y) => y - x)])
            .filter(([, , bright, dark]) => (bright + 0.05) / (dark + 0.05) < 4.5);
    }""")
    assert not low, f"too little contrast: {low}"


def fits(visitor: Visitor) -> None:
    """Check that nothing is wider than a phone, and take each part's picture."""
    page = visitor.page
    for tab in ("Overview", "Surrogate", "Dataset", "Optima", "Stroke"):
        visitor.open(tab)
        width = page.evaluate("document.documentElement.scrollWidth")
        assert width <= 390, f"{tab} is {width} wide"
        is_accessible(page)
        shot(page, f"phone-{tab.lower()}")


def reach_by_keyboard(page: Page) -> None:
    page.reload()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    page.get_by_label("Change between light and dark").press("Enter")


def ask_for_token(browser: Browser) -> None:
    service = Service(token=TOKEN)
    try:
        visitor = Visitor(browser, service.url)
        visitor.page.get_by_role("textbox", name="Token").fill(TOKEN)
        visitor.page.get_by_role("button", name="Use it").click()
        expect(visitor.page.get_by_text("There is no study yet")).to_be_visible()
        expect(visitor.page.locator("#live")).to_have_text("live")
        visitor.context.close()
    finally:
        service.stop()


def whole_story(browser: Browser, service: Service) -> None:
    visitor = Visitor(browser, service.url, viewport={"width": 1280, "height": 900}, color_scheme="light")
    page = visitor.page
    submit(page)
    visitor.errors.clear()  # the refusal just asked for
    page.get_by_label("The study").fill(STUDY)
    page.get_by_role("button", name="Check").click()
    expect(page.get_by_text("It would be accepted")).to_be_visible()
    shot(page, "submit")
    page.get_by_role("button", name="Submit").click()
    watch(page)
    say("the study was submitted and has succeeded")
    look(visitor)
    say("training, samples and optima are drawn")
    play(visitor)
    is_accessible(page)
    say("a stroke was tried")
    reach_by_keyboard(page)
    expect(page.locator("html")).to_have_attribute("data-theme", "dark")
    is_accessible(page)
    visitor.open("Surrogate")
    shot(page, "surrogate-dark")
    page.get_by_role("link", name="Studies").click()
    expect(page.get_by_role("cell", name="succeeded")).to_be_visible()
    shot(page, "studies-dark")
    page.get_by_role("link", name="Workers").click()
    leave = page.get_by_role("button", name=re.compile("finish and leave"))
    leave.click()
    page.get_by_role("button", name="Let it leave").click()
    expect(leave).to_have_count(0)
    shot(page, "workers-dark")
    page.get_by_role("link", name="Studies").click()
    visitor.is_content()
    study = page.get_by_role("link", name="browser").get_attribute("href")
    visitor.context.close()

    phone = Visitor(
        browser, f"{service.url}/{study}", viewport={"width": 390, "height": 844}, has_touch=True, color_scheme="dark"
    )
    fits(phone)
    phone.is_content()
    say("it fits on a phone")
    took = service.stop()
    assert took < 8, f"the coordinator waited {took:.1f} s for the page"
    expect(phone.page.locator("#live")).to_have_text("no answer")
    phone.context.close()


def main() -> None:
    service = Service()
    try:
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(
                executable_path=os.environ.get("CHROMIUM") or shutil.which("chromium"),
                args=["--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
            )
            whole_story(browser, service)
            ask_for_token(browser)
            say("a token was asked for and taken")
            browser.close()
    finally:
        service.stop()
    say("done")


if __name__ == "__main__":
    main()
