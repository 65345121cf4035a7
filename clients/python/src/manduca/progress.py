"""How far a study is: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from manduca.views import StudyView

_BETWEEN_LINES_S = 5.0
_BAR = 30


@dataclass(frozen=True)
class Glance:
    """The present stage at a glance; `total` is 0 where it is not known."""

    stage: str
    done: int
    total: int
    detail: str


def glance(view: StudyView) -> Glance:
    """Tell what there is to say about the present stage."""
    stage = view["paused_from"] or view["state"]
    jobs, progress = view["stage_jobs"], view["progress"]
    details = []
    if stage == "sampling":
        done, total = view["samples"]["succeeded"], int(view["spec"]["sampling"]["samples"])
        if view["rate_per_s"] and view["state"] != "paused":
            details.append(f"{view['rate_per_s']:.1f}/s")
    elif progress:
        done, total = progress["done"], progress["total"]
        details.append(progress["note"])
    else:
        done = jobs["succeeded"] + jobs["infeasible"]
        total = done + jobs["ready"] + jobs["delayed"] + jobs["leased"] + jobs["dead"]
    if view["eta_s"] is not None and done < total and view["state"] != "paused":
        details.append(f"{span(view['eta_s'])} left")
    troubles = (
        (jobs["infeasible"], "infeasible"),
        (jobs["delayed"], "to be retried"),
        (jobs["dead"], "given up"),
    )
    details += [f"{count} {what}" for count, what in troubles if count]
    if view["state"] == "paused":
        details.append("paused")
    return Glance(stage, done, total, ", ".join(details))


def span(seconds: float) -> str:
    """Say seconds as a person does."""
    if seconds < 10:
        return f"{max(seconds, 0.0):.1f} s"
    minutes, whole = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes:02} min"
    return f"{minutes} min {whole:02} s" if minutes else f"{whole} s"


class Meter:
    """Shows one glance after the other on a stream; is told what time it is, s."""

    def __init__(self, out: TextIO) -> None:
        """Find out whether it is a terminal."""
        self._out = out
        self._terminal = out.isatty()
        self._shown: Glance | None = None
        self._warned = ""
        self._since = self._line_at = 0.0

    def show(self, now: Glance, at: float, warning: str = "") -> None:
        """Show where a study is, and a warning once."""
        new_stage = self._shown is None or self._shown.stage != now.stage
        if new_stage:
            self.close_stage(at)
            self._since = at
        if warning and warning != self._warned:
            self._say(warning)
        self._warned = warning
        if self._terminal:
            self._draw(now)
        elif now != self._shown and (new_stage or at - self._line_at >= _BETWEEN_LINES_S):
            self._say(line(now))
            self._line_at = at
        self._shown = now

    def close_stage(self, at: float) -> None:
        """Say how long a stage took."""
        if self._shown is not None:
            self._say(f"{self._shown.stage:10} done in {span(at - self._since)}")
            self._shown = None

    def clear(self) -> None:
        """Take the bar away."""
        if self._terminal:
            self._write("\r\x1b[K")

    def _draw(self, now: Glance) -> None:
        filled = _BAR * now.done // now.total if now.total else 0
        bar = "#" * filled + "-" * (_BAR - filled)
        text = f"{now.stage:10} {bar} {now.done}/{now.total}  {now.detail}"
        self._write("\r\x1b[K" + text[: shutil.get_terminal_size().columns - 1])

    def _say(self, text: str) -> None:
        self.clear()
        self._write(text + "\n")

    def _write(self, text: str) -> None:
        self._out.write(text)
        self._out.flush()


def line(now: Glance) -> str:
    """Put a glance into one line."""
    return f"{now.stage:10} {now.done}/{now.total}" + (f"  {now.detail}" if now.detail else "")
