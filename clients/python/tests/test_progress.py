"""What waiting shows."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

from manduca.progress import Glance, Meter, glance, line, span

if TYPE_CHECKING:
    import pytest

    from manduca.views import JobCounts, StudyView

JOBS: JobCounts = {
    "ready": 174,
    "delayed": 0,
    "leased": 2,
    "succeeded": 120,
    "infeasible": 4,
    "dead": 0,
    "cancelled": 0,
}


def view(**changes: Any) -> StudyView:
    sampling: StudyView = {
        "id": "x",
        "state": "sampling",
        "paused_from": None,
        "failure": None,
        "created_at": "",
        "spec": {"sampling": {"samples": 300}},
        "solver_version": "9",
        "samples": JOBS,
        "stage_jobs": JOBS,
        "audits": JOBS,
        "progress": None,
        "rate_per_s": 12.34,
        "eta_s": 75.0,
        "stages_s": {},
        "surrogate": None,
        "optimisations": [],
    }
    return sampling | changes  # type: ignore[return-value]


def test_a_stage_at_a_glance() -> None:
    assert line(glance(view())) == "sampling   120/300  12.3/s, 1 min 15 s left, 4 infeasible"
    step = {"done": 3, "total": 9, "note": "iteration 3"}
    none = dict.fromkeys(JOBS, 0)
    resting = view(state="paused", paused_from="training", progress=step, stage_jobs=none, eta_s=None)
    assert line(glance(resting)) == "training   3/9  iteration 3, paused"
    assert line(glance(view(state="verifying", eta_s=None))) == "verifying  124/300  4 infeasible"


def test_spans_read_well() -> None:
    said = [span(seconds) for seconds in (0.04, 9.94, 59.6, 3599.0, 7260.0)]
    assert said == ["0.0 s", "9.9 s", "1 min 00 s", "59 min 59 s", "2 h 01 min"]


def test_without_a_terminal_a_line_now_and_then() -> None:
    out = io.StringIO()
    meter = Meter(out)
    for at in range(8):
        meter.show(Glance("sampling", at, 9, ""), at, "no worker" if at < 3 else "")
    meter.show(Glance("training", 0, 5, "iteration 0"), 8.0)
    meter.close_stage(9.5)
    meter.clear()
    assert out.getvalue().splitlines() == [
        "no worker",
        "sampling   0/9",
        "sampling   5/9",
        "sampling   done in 8.0 s",
        "training   0/5  iteration 0",
        "training   done in 1.5 s",
    ]


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_on_a_terminal_a_bar_which_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    out = Terminal()
    meter = Meter(out)
    meter.show(Glance("sampling", 150, 300, "12.3/s, " + "x" * 90), 0.0)
    meter.show(Glance("training", 0, 0, ""), 1.0)
    meter.clear()
    drawn = out.getvalue().split("\r\x1b[K")
    assert drawn[1].startswith("sampling   " + "#" * 15 + "-" * 15 + " 150/300  12.3/s")
    assert len(drawn[1]) == 59
    assert drawn[-1] == ""
