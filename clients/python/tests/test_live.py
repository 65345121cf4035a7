"""Against a coordinator and a worker which run."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import TYPE_CHECKING, Any
from urllib.request import urlopen

import pytest
from conftest import REPOSITORY, SAMPLES, blades

import manduca
from manduca import views

if TYPE_CHECKING:
    from pathlib import Path


def _schemas(client: manduca.Client) -> dict[str, Any]:
    with urlopen(f"{client.url}/openapi.json") as answer:
        schemas: dict[str, Any] = json.load(answer)["components"]["schemas"]
    return schemas


def test_the_views_are_those_of_the_openapi_document(client: manduca.Client) -> None:
    schemas = _schemas(client)
    for name in (
        "StudySummary",
        "StudyView",
        "JobView",
        "JobCounts",
        "WorkerView",
        "DryRun",
        "SurrogateView",
    ):
        assert set(getattr(views, name).__annotations__) == set(schemas[name]["properties"]), name
    for name in ("Progress", "Estimate", "OptimumResult"):
        assert set(getattr(views, name).__annotations__) == set(schemas[name]["properties"]), name
    assert set(views.StudyState.__args__) == set(schemas["StudyState"]["enum"])  # type: ignore[attr-defined]
    assert set(views.JobState.__args__) == set(schemas["JobState"]["enum"])  # type: ignore[attr-defined]


def test_a_study_comes_to_its_optimum(study: manduca.Study) -> None:
    view = study.status()
    assert view["state"] == "succeeded"
    assert view["samples"]["succeeded"] == SAMPLES
    optimum = study.optimum()
    assert optimum == study.optima()[0] == study.optimum("free")
    assert tuple(optimum.parameters) == manduca.PARAMETERS
    assert optimum.simulated is not None
    assert optimum.simulated["power"]["mean"] > 0
    assert "sweep_amplitude_deg" in str(optimum)
    assert "refined" in str(optimum)


def test_the_dataset_is_the_same_in_each_form(study: manduca.Study) -> None:
    frame, table, rows = study.dataset(), study.dataset_arrow(), list(study.rows())
    assert len(frame) == table.num_rows == len(rows) == SAMPLES
    assert list(frame.columns) == table.column_names
    assert tuple(frame.columns[2:12]) == manduca.PARAMETERS
    for name in manduca.PARAMETERS:
        sent = [row["parameters"][name] for row in rows]
        assert frame[name].tolist() == sent == table[name].to_pylist()
    for name in manduca.OUTPUTS:
        sent = [row["scaled"][name]["mean"] for row in rows]
        assert frame[name].tolist() == sent == table[name].to_pylist()
    facts = table.schema.metadata
    assert facts[b"manduca.study"].decode() == study.id
    assert json.loads(facts[b"manduca.model"])["kind"] == "quasi-steady"
    units = {field.name: (field.metadata or {}).get(b"unit") for field in table.schema}
    assert units["pitch_moment_nm_se"] == b"N m"
    assert units["power"] == b"1"
    assert units["reason"] is None
    assert set(frame.solver_version) == {rows[0]["solver_version"]}
    assert set(frame.reason) == {""}


def test_predictions_keep_shape_and_order(study: manduca.Study) -> None:
    frame = study.dataset().iloc[::-3]
    table = study.predict(frame)
    assert table.index.equals(frame.index)
    points = [
        dict(zip(manduca.PARAMETERS, row, strict=True)) for row in frame[list(manduca.PARAMETERS)].to_numpy()
    ]
    listed = study.predict(points)
    assert table.to_dict("records") == listed
    assert study.predict(points[2]) == listed[2]
    tested = study.surrogate()["test"]
    assert tested is not None
    assert listed[0].test_rmse == table.attrs["test_rmse"] == tested["rmse"]
    with pytest.warns(UserWarning, match="frequency_hz"):
        study.predict(points[2] | {"frequency_hz": 299.0})
    # More than the coordinator takes at once.
    assert study.predict(points * 90)[-1] == listed[-1]
    assert len(study.predict(points * 90)) == 90 * len(points) > 1000
    assert study.predict([]) == []


def test_a_stroke_is_flown_as_in_the_study(study: manduca.Study, client: manduca.Client) -> None:
    row = next(study.rows())
    flown = study.simulate(row["parameters"])
    assert flown["means"] == row["means"]
    assert flown["history"][0]["step"] == 0
    coarse = {"chordwise_panels": 2, "spanwise_panels": 3, "steps_per_stroke": 12, "strokes": 5}
    lattice = client.simulate(row["parameters"], model={"solver": coarse}, wake="last")
    assert len(lattice["wake"]) == 1
    assert lattice["means"] != row["means"]
    schemas = _schemas(client)
    assert set(views.SimulationView.__annotations__) >= set(lattice)
    assert set(views.Wake.__args__) == set(schemas["WakeChoice"]["enum"])  # type: ignore[attr-defined]


def test_the_network_can_be_taken(study: manduca.Study) -> None:
    model = study.model()
    assert len(model["networks"]) == 1
    assert b"manduca" in study.onnx()[:100]


def test_jobs_and_surrogate(study: manduca.Study) -> None:
    assert sum(job["role"] == "sample" for job in study.jobs(state="succeeded", kind="simulate")) == SAMPLES
    assert [job["state"] for job in study.jobs(kind="train")] == ["succeeded"]
    surrogate = study.surrogate()
    assert surrogate["neurons"] == 6
    assert surrogate["test"] is not None


def test_a_further_optimum(study: manduca.Study) -> None:
    asked: dict[str, Any] = {
        "parameters": {"stroke_plane_deg": 10.0, "frequency_hz": (20.0, 30.0)},
        "starts": 5,
    }
    for _ in range(2):  # asked for twice, found once
        assert study.optimise("tilted", refine_simulations=0, **asked)["name"] == "tilted"
        study.wait(progress=False, timeout_s=120)
    optimum = study.optimum("tilted")
    assert optimum.parameters["stroke_plane_deg"] == 10.0
    assert 20.0 <= optimum.parameters["frequency_hz"] <= 30.0
    assert not optimum.refined
    assert [found.name for found in study.optima()] == ["free", "tilted"]


def test_a_key_names_a_study(client: manduca.Client, study: manduca.Study) -> None:
    spec = {**blades("keyed"), "sampling": {"samples": 30}}
    first = client.submit(spec, idempotency_key="one")
    assert client.submit(spec, idempotency_key="one").id == first.id
    with pytest.raises(manduca.ProblemError, match="another idempotency_key") as refused:
        client.submit({**spec, "seed": 9}, idempotency_key="one")
    assert refused.value.problem.slug == "idempotency-key-reused"
    assert client.submit(spec).id != first.id
    assert {first.id, study.id} <= {summary["id"] for summary in client.studies()}
    assert client.study(first.id).id == first.id


def test_files_of_both_kinds(client: manduca.Client, tmp_path: Path) -> None:
    for name in ("quick.toml", "quick.json"):
        assert client.dry_run(REPOSITORY / "studies" / name)["errors"] == []
    broken = tmp_path / "broken.toml"
    broken.write_text("name = ")
    with pytest.raises(ValueError, match=r"broken\.toml"):
        client.submit(broken)
    with pytest.raises(FileNotFoundError):
        client.submit(str(tmp_path / "none.toml"))


def test_a_study_is_steered(client: manduca.Client) -> None:
    study = client.submit({**blades("steered"), "seed": 7, "sampling": {"samples": 3000}})
    with pytest.raises(manduca.NotYetError, match=r"study\.wait"):
        study.optimum()
    with pytest.raises(manduca.NotYetError):
        study.surrogate()
    with pytest.raises(manduca.NotYetError):
        study.predict(dict.fromkeys(manduca.PARAMETERS, 1.0) | {"frequency_hz": 25.0})
    assert study.pause()["state"] == "paused"
    with pytest.raises(manduca.WaitTimeoutError, match="goes on"):
        study.wait(progress=False, timeout_s=0.1, poll_s=0.1)
    assert study.resume()["state"] == "sampling"
    assert study.cancel()["state"] == "cancelled"
    with pytest.raises(manduca.StudyEndedError, match="cancelled"):
        study.wait(progress=False)
    with pytest.raises(manduca.WrongStateError) as refused:
        study.retry_failed()
    assert refused.value.problem.status == 409


def test_refusals_name_the_fields(client: manduca.Client, study: manduca.Study) -> None:
    wrong = {"name": "x", "sampling": {"samples": 20, "faces": 2}, "parameters": {"frequency_hz": [40, 15]}}
    with pytest.raises(manduca.ProblemError) as refused:
        client.submit(wrong)
    faults = {fault.pointer for fault in refused.value.problem.errors}
    assert faults == {"/parameters/frequency_hz", "/sampling/faces"}
    assert "/sampling/faces: 2 is outside" in str(refused.value)
    assert {fault["pointer"] for fault in client.dry_run(wrong)["errors"]} == faults
    with pytest.raises(manduca.ProblemError, match=r"client\.studies"):
        client.study("no-such-study")
    with pytest.raises(manduca.ProblemError, match="no optimisation `none`"):
        study.optimum("none")
    with pytest.raises(ValueError, match="JSON"):
        study.predict(dict.fromkeys(manduca.PARAMETERS, float("nan")))


def test_the_example_runs(client: manduca.Client, tmp_path: Path) -> None:
    file = tmp_path / "study.json"
    file.write_text(json.dumps(blades("blades")))
    settings = {"MANDUCA_COORDINATOR": client.url, "MANDUCA_STUDY": str(file), "MPLBACKEND": "agg"}
    example = REPOSITORY / "clients" / "python" / "examples" / "hover.py"
    ran = subprocess.run(
        [sys.executable, example],
        cwd=tmp_path,
        env={**os.environ, **settings},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    assert "free, refined" in ran.stdout
    assert (tmp_path / "hover.png").stat().st_size > 10_000
