"""Every chart of a study in every mode, drawn with WebGL and without."""

from __future__ import annotations

import base64
import re
from typing import TYPE_CHECKING

from playwright.sync_api import expect

from service import STUDY, Service
from visitor import PATIENCE, Visitor, say, shot

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator, Page

# A study with charts of every kind: a network, its optimum refined, and generations of the genetic algorithm.
WHOLE = STUDY.replace('name = "browser"', 'name = "charts"') + """
[[optimisations]]
name = "bred"
method = "paper"
population = 40
generations = 6
verify_strokes = 4
refine_simulations = 0
"""

# Pixels of a picture which have a colour, and not only a grey.
COLOURED = """async (data) => {
    const image = new Image();
    image.src = data;
    await image.decode();
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [image.width, image.height];
    const context = canvas.getContext("2d");
    context.drawImage(image, 0, 0);
    const { data: bytes } = context.getImageData(0, 0, image.width, image.height);
    let count = 0;
    for (let i = 0; i < bytes.length; i += 4) {
        const [low, high] = [Math.min(bytes[i], bytes[i + 1], bytes[i + 2]), Math.max(bytes[i], bytes[i + 1], bytes[i + 2])];
        if (high - low > 50) count += 1;
    }
    return count;
}"""

# Where the library draws points of a cloud and lines.
POINTS = ".scatterlayer .points path"


class Looker:
    """One visitor who looks at every chart."""

    def __init__(self, visitor: Visitor, *, webgl: bool) -> None:
        self.visitor, self.page, self.webgl = visitor, visitor.page, webgl
        self.judge: Page = visitor.context.new_page()
        self.seen = 0

    def is_drawn(self, plot: Locator, what: str, least: int = 60) -> None:
        """Check that a chart has coloured pixels, soon if not yet."""
        plot.scroll_into_view_if_needed()
        count = 0
        for _ in range(40):
            self.page.wait_for_timeout(100)
            picture = base64.b64encode(plot.screenshot()).decode()
            count = self.judge.evaluate(COLOURED, f"data:image/png;base64,{picture}")
            if count >= least:
                break
        assert count >= least, f"{what}: {count} coloured pixels"
        text = plot.inner_text()
        assert "cannot be drawn" not in text and "not supported" not in text, f"{what}: {text[:200]}"
        assert not self.visitor.errors, f"{what}: {self.visitor.errors}"
        self.seen += 1

    def all_drawn(self, tab: str) -> None:
        plots = self.page.locator("#tab .plot:visible")
        for i in range(plots.count()):
            self.is_drawn(plots.nth(i), f"{tab}, chart {i}")

    def choose(self, selector: str) -> list[str]:
        """Give the values of a choice."""
        return self.page.locator(selector).locator("option").evaluate_all("(all) => all.map((o) => o.value)")

    def some(self, values: list[str]) -> list[str]:
        """Give all values with WebGL; without, where the same code draws, the first, the middle and the last."""
        return values if self.webgl else [values[0], values[len(values) // 2], values[-1]]

    def dataset(self) -> None:
        page = self.page
        self.visitor.open("Dataset")
        plot = page.locator("#tab .plot")
        colours = self.choose("#explore-by")
        assert len(colours) == 14, colours
        # Back to the first at the end: what one kind leaves behind must not spoil the other.
        for kind, some in (("parallel", self.some(colours)), ("cloud", self.some(colours)), ("parallel", colours[:1])):
            page.select_option("#explore-kind", kind)
            for by in some:
                page.select_option("#explore-by", by)
                self.is_drawn(plot, f"{kind} by {by}", 300)
                if kind == "cloud":
                    expect(plot.locator(POINTS)).to_have_count(60, timeout=PATIENCE)
            shot(page, f"{kind}-{'gl' if self.webgl else 'plain'}")
        page.select_option("#explore-kind", "cloud")
        for axis in ("x", "y"):
            for quantity in self.some(self.choose(f"#explore-{axis}")):
                page.select_option(f"#explore-{axis}", quantity)
                self.is_drawn(plot, f"{axis} is {quantity}")
                expect(plot.locator(POINTS)).to_have_count(60, timeout=PATIENCE)

    def surrogate(self) -> None:
        self.visitor.open("Surrogate")
        for share in self.choose("#share"):
            self.page.select_option("#share", share)
            # Four means of each sample.
            expect(self.page.locator(POINTS)).to_have_count(4 * (48 if share == "train" else 6), timeout=PATIENCE)
            self.all_drawn(f"share {share}")

    def optima(self) -> None:
        page = self.page
        self.visitor.open("Optima")
        self.all_drawn("Optima")
        for heading in ("Generations", "Refining"):
            expect(page.locator("#tab").get_by_role("heading", name=heading)).to_be_visible()
        front = page.locator("section").filter(has=page.get_by_role("heading", name="Front of power"))
        for within in self.choose("#front-within"):
            page.select_option("#front-within", within)
            page.get_by_role("button", name="Compute").click()
            answered = re.compile("Free, stroke plane is|knows no stroke in trim")
            expect(front).to_contain_text(answered, timeout=PATIENCE)
            if front.locator(".plot").is_visible():
                self.is_drawn(front.locator(".plot"), f"front within {within}")

    def stroke(self) -> None:
        page = self.page
        self.visitor.open("Stroke")
        flat = page.get_by_text("no WebGL")
        if self.webgl:
            expect(flat).to_have_count(0)
        else:
            expect(flat).to_be_visible()
        for i in range(page.locator("#preset option").count()):
            page.select_option("#preset", index=i)
            page.wait_for_timeout(150)
            self.all_drawn(f"preset {i}")
        page.select_option("#preset", index=0)
        page.get_by_role("button", name="Fly this stroke").click()
        expect(page.get_by_text("Means over")).to_be_visible(timeout=PATIENCE)
        for at in (0, 5, 11):
            page.get_by_role("slider", name="Time").fill(str(at))
            page.wait_for_timeout(150)
            self.all_drawn(f"step {at}")
        shot(page, f"flown-{'gl' if self.webgl else 'plain'}")

    def look(self, *, whole: bool) -> None:
        self.visitor.open("Overview")
        self.all_drawn("Overview")
        if not whole:
            for tab in ("Surrogate", "Dataset", "Optima", "Stroke"):
                self.visitor.open(tab)
                self.all_drawn(tab)
                shot(self.page, f"phone-{tab.lower()}-{'gl' if self.webgl else 'plain'}")
            self.page.select_option("#preset", index=1)
            return
        self.surrogate()
        self.dataset()
        self.optima()
        self.stroke()
        self.page.get_by_label("Change between light and dark").click()
        self.all_drawn("in other colours")


def submitted(service: Service) -> str:
    """Submit the study and wait for its end."""
    id_ = service.submit(WHOLE)
    for _ in range(PATIENCE // 200):
        state = service.ask(f"/v1/studies/{id_}")["state"]
        if state in ("succeeded", "failed"):
            break
        service.wait(0.2)
    assert state == "succeeded", state
    return id_


def check(browser: Browser, service: Service, *, webgl: bool, study: str | None = None) -> str:
    """Look at every chart; give the study looked at."""
    study = study or submitted(service)
    wide = {"viewport": {"width": 1280, "height": 900}, "color_scheme": "light"}
    narrow = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "color_scheme": "dark"}
    for name, screen in (("wide", wide), ("narrow", narrow)):
        visitor = Visitor(browser, f"{service.url}/#/studies/{study}", **screen)
        there = visitor.page.evaluate('Boolean(document.createElement("canvas").getContext("webgl"))')
        assert there == webgl, f"WebGL: {there}"
        looker = Looker(visitor, webgl=webgl)
        looker.look(whole=name == "wide")
        visitor.is_content()
        visitor.context.close()
        say(f"{looker.seen} charts are drawn {'with' if webgl else 'without'} WebGL, {name}")
    return study
