"""A browser, its pages, and what they complain of."""

from __future__ import annotations

import os
import shutil
import time
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from playwright.sync_api import expect

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Playwright

# Machines of every speed: what is waited for comes, or the test ends here, ms.
PATIENCE = 180_000
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


def launch(playwright: Playwright, *arguments: str, webgl: bool = True) -> Browser:
    """Start a browser which draws with or without WebGL, whatever the machine has."""
    drawing = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    return playwright.chromium.launch(
        executable_path=os.environ.get("CHROMIUM") or shutil.which("chromium"),
        args=["--no-sandbox", "--disable-dev-shm-usage", *(drawing if webgl else ["--disable-3d-apis"]), *arguments],
    )


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
