"""What the coordinator answers, as typed dictionaries; more fields may be added by newer ones.

`GET /openapi.json` has the same in full, and a test compares the two.
"""

from __future__ import annotations

from typing import Any, Literal, NotRequired, TypedDict

PARAMETERS = (
    "frequency_hz",
    "stroke_plane_deg",
    "sweep_mean_deg",
    "elevation_mean_deg",
    "rotation_mean_deg",
    "sweep_amplitude_deg",
    "elevation_amplitude_deg",
    "rotation_amplitude_deg",
    "sweep_shape",
    "rotation_shape",
)
"""The ten parameters of a stroke, in the order of the coordinator's table."""

OUTPUTS = ("lift", "drag", "pitch_moment", "power")
"""The four scaled outputs L+, D+, M+ and P+."""

StudyState = Literal[
    "sampling",
    "training",
    "optimising",
    "verifying",
    "refining",
    "succeeded",
    "failed",
    "cancelled",
    "paused",
]
JobState = Literal["ready", "delayed", "leased", "succeeded", "infeasible", "dead", "cancelled"]
JobKind = Literal["simulate", "train", "optimise", "search"]
Method = Literal["sqp", "paper", "direct"]
Wake = Literal["last", "stroke"]
Parameters = dict[str, float]


class JobCounts(TypedDict):
    """How many jobs are in each state."""

    ready: int
    delayed: int
    leased: int
    succeeded: int
    infeasible: int
    dead: int
    cancelled: int


class Progress(TypedDict):
    """Where a long job is."""

    done: int
    total: int
    note: str


class Estimate(TypedDict):
    """Mean and standard error."""

    mean: float
    se: float


Scaled = dict[str, float]
"""L+, D+, M+, P+ by the names of `OUTPUTS`."""

ScaledEstimates = dict[str, Estimate]
"""L+, D+, M+, P+ with standard errors, by the names of `OUTPUTS`."""


class StudySummary(TypedDict):
    """A study in a list."""

    id: str
    name: str
    state: StudyState
    created_at: str
    samples: int
    samples_succeeded: int
    submitted_by: NotRequired[str]


class StudyView(TypedDict):
    """A whole study: state, counts, rate and time left of the present stage."""

    id: str
    state: StudyState
    paused_from: StudyState | None
    failure: str | None
    created_at: str
    spec: dict[str, Any]
    solver_version: str
    samples: JobCounts
    stage_jobs: JobCounts
    audits: JobCounts
    progress: Progress | None
    rate_per_s: float | None
    eta_s: float | None
    stages_s: dict[str, float | None]
    surrogate: dict[str, Any] | None
    optimisations: list[dict[str, Any]]
    audit_verdicts: NotRequired[dict[str, int]]
    distrusted: NotRequired[list[dict[str, Any]]]
    disowned_results: NotRequired[int]
    steered_by: NotRequired[str]
    submitted_by: NotRequired[str]


class ComputedBy(TypedDict):
    """The origin of a result."""

    job: int
    worker: str
    worker_name: str
    token: NotRequired[str]


class JobView(TypedDict):
    """A job; `reason` is its last failure, or why its stroke cannot be flown."""

    id: int
    kind: JobKind
    role: str
    ordinal: int
    state: JobState
    attempt: int
    worker: str | None
    reason: str | None
    cached: bool
    provenance: dict[str, Any] | None
    computed_by: NotRequired[ComputedBy]
    worker_name: NotRequired[str]
    token: NotRequired[str]


class WorkerView(TypedDict):
    """A worker."""

    id: str
    name: str
    slots: int
    level: str
    leased: int
    completed: int
    failed: int
    last_seen_s: float
    alive: bool
    strikes: int
    quarantined: bool
    draining: bool
    set_aside: NotRequired[str]
    token: NotRequired[str]
    drained_by: NotRequired[str]


class DryRun(TypedDict):
    """What a study would cost, and its faults."""

    simulations: int
    errors: list[dict[str, str]]


class SurrogateView(TypedDict):
    """Training curve so far and, once it is done, the errors of the network."""

    kind: str
    curve: list[dict[str, Any]]
    best_iterations: list[int]
    stops: list[str]
    neurons: int
    train: dict[str, Any] | None
    validation: dict[str, Any] | None
    test: dict[str, Any] | None
    disowned_results: NotRequired[int]


class SimulationView(TypedDict):
    """A stroke flown: its means as in a sample, its last stroke step by step, the vortex rings asked for."""

    parameters: Parameters
    model: dict[str, Any]
    solver_version: str
    outcome: Literal["ok", "infeasible"]
    reason: NotRequired[str]
    means: NotRequired[dict[str, Estimate]]
    scaled: NotRequired[ScaledEstimates]
    joints: NotRequired[dict[str, dict[str, float]]]
    power_per_lift_w_per_n: NotRequired[float | None]
    strokes_averaged: NotRequired[int]
    strokes_dropped: int
    history: list[dict[str, float]]
    axes: str
    side: str
    circulation: str
    wake: list[dict[str, Any]]


class OptimumResult(TypedDict, total=False):
    """One optimisation, flat, as `GET .../optimum` has it."""

    name: str
    status: Literal["pending", "optimised", "verified", "refined", "failed"]
    parameters: Parameters | None
    predicted: Scaled | None
    simulated: ScaledEstimates | None
    infeasible: str | None
    power_per_lift_w_per_n: float | None
    stopped: str
    clearance_mm: float | None
    refined_clearance_mm: float
    clearance_margin_mm: float
    paper: str
    warnings: list[str]
    optimality: dict[str, Any]
    breeding: dict[str, Any]
    refined: dict[str, Any] | None
