"""What a scientist does on the dashboard, done by a browser."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from playwright.sync_api import expect, sync_playwright

import attack
import charts
from service import STUDY, TOKEN, Service
from visitor import PATIENCE, Visitor, launch, say, shot

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

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


def documents_routes(browser: Browser, service: Service) -> None:
    """Read the document of the routes, and try one of them."""
    visitor = Visitor(browser, f"{service.url}/docs")
    page = visitor.page
    page.get_by_role("button", name=re.compile("GET.*healthz")).first.click()
    page.get_by_role("button", name="Try it out").click()
    page.get_by_role("button", name="Execute").click()
    expect(page.locator(".live-responses-table")).to_contain_text("solver_version", timeout=PATIENCE)
    shot(page, "docs")
    visitor.is_content()
    visitor.context.close()
    say("the routes are described and tried")


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
    drain = page.get_by_role("button", name=re.compile("^Drain "))
    drain.click()
    dialog = page.get_by_role("dialog")
    expect(dialog.get_by_role("button")).to_have_text(["Cancel", "Drain worker"])
    dialog.get_by_role("button", name="Cancel").click()
    expect(dialog).to_have_count(0)
    expect(drain).to_have_count(1)
    drain.click()
    shot(page, "drain-dark")
    dialog.get_by_role("button", name="Drain worker").click()
    expect(drain).to_have_count(0)
    shot(page, "workers-dark")
    expect(page.get_by_text("No worker is registered")).to_be_visible(timeout=PATIENCE)
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
    with sync_playwright() as playwright:
        attack.check(playwright)
        service = Service()
        try:
            browser = launch(playwright)
            study = charts.check(browser, service, webgl=True)
            without = launch(playwright, webgl=False)
            charts.check(without, service, webgl=False, study=study)
            without.close()
            documents_routes(browser, service)
            ask_for_token(browser)
            say("a token was asked for and taken")
        finally:
            service.stop()
        service = Service()
        try:
            whole_story(browser, service)
            browser.close()
        finally:
            service.stop()
    say("done")


if __name__ == "__main__":
    main()
