"""One study: watch it, steer it, take its data, ask its network, read its optimum."""

from __future__ import annotations

import io
import json
import sys
import time
import warnings
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, cast, overload
from urllib.parse import quote

from manduca import dataset
from manduca.errors import (
    URN,
    ManducaError,
    NotYetError,
    Problem,
    ProblemError,
    StudyEndedError,
    WaitTimeoutError,
)
from manduca.optimum import Optimum
from manduca.progress import Meter, glance
from manduca.views import OUTPUTS, PARAMETERS

if TYPE_CHECKING:
    from collections.abc import Iterator

    import pandas as pd
    import pyarrow as pa

    from manduca._http import Transport
    from manduca.views import (
        JobKind,
        JobState,
        JobView,
        Method,
        Scaled,
        SimulationView,
        StudyView,
        SurrogateView,
        Wake,
    )

_MOST_POINTS = 1000
_OUTAGE_S = 60.0


class Prediction(dict[str, float]):
    """L+, D+, M+ and P+ as the surrogate foresees them, and what that is worth."""

    def __init__(self, scaled: Mapping[str, float], by: str | None, test_rmse: Scaled | None) -> None:
        """Take what the coordinator says; older ones say only the values."""
        super().__init__(scaled)
        self.by = by
        """Who predicts: the surrogate as it was trained."""
        self.test_rmse = test_rmse
        """Its root mean square errors on strokes of the box which it has not seen."""


class Study:
    """A study of a coordinator; get one from `Client.submit` or `Client.study`."""

    def __init__(self, transport: Transport, study: str) -> None:
        """Name it; nothing is sent yet."""
        self._transport = transport
        self.id = study
        self._path = f"/v1/studies/{quote(study, safe='')}"

    def __repr__(self) -> str:
        """Tell id and address."""
        return f"<Study {self.id} at {self._transport.url}>"

    def status(self) -> StudyView:
        """Tell state, counts, rate and time left."""
        view: StudyView = self._transport.get(self._path)
        return view

    def wait(
        self, *, progress: bool = True, timeout_s: float | None = None, poll_s: float = 0.5
    ) -> StudyView:
        """Wait until the study is done, with a bar on a terminal and a line now and then elsewhere.

        Ctrl-C stops waiting, not the study. A coordinator that is away for less than a minute is
        waited for. Raises `StudyEndedError` if it fails or is cancelled, `WaitTimeoutError` after
        `timeout_s`.
        """
        meter = Meter(sys.stderr) if progress else None
        try:
            for view in self._looks(timeout_s, poll_s):
                if view["state"] in {"failed", "cancelled"}:
                    raise StudyEndedError(view)
                if meter and view["state"] != "succeeded":
                    meter.show(glance(view), time.monotonic(), self._nobody_works(view))
            if meter:
                meter.close_stage(time.monotonic())
            return view
        finally:
            if meter:
                meter.clear()

    def _looks(self, timeout_s: float | None, poll_s: float) -> Iterator[StudyView]:
        """Look again and again, over short absences of the coordinator, until the study has succeeded."""
        begun = heard = time.monotonic()
        while True:
            try:
                view = self.status()
            except ManducaError as error:
                if not error.passing or time.monotonic() - heard > _OUTAGE_S:
                    raise
            else:
                heard = time.monotonic()
                yield view
                if view["state"] == "succeeded":
                    return
            if timeout_s is not None and time.monotonic() - begun >= timeout_s:
                raise WaitTimeoutError(f"study {self.id} is not done after {timeout_s} s; it goes on")
            time.sleep(poll_s)

    def _nobody_works(self, view: StudyView) -> str:
        """Say so where jobs wait and no worker is there to take them."""
        jobs = view["stage_jobs"]
        if view["state"] == "paused" or jobs["leased"] or not jobs["ready"]:
            return ""
        try:
            workers = self._transport.get("/v1/workers")
        except ManducaError:
            return ""  # the next look tells what it is
        if any(worker["alive"] for worker in workers):
            return ""
        return f"no worker is connected: manduca worker --coordinator {self._transport.url}"

    def jobs(self, state: JobState | None = None, kind: JobKind | None = None) -> Iterator[JobView]:
        """List jobs, page after page as they are asked for."""
        return pages(self._transport, f"{self._path}/jobs", state=state, kind=kind)

    def pause(self) -> StudyView:
        """Give out no more jobs; what runs may finish."""
        return self._steer("pause")

    def resume(self) -> StudyView:
        """Go on."""
        return self._steer("resume")

    def cancel(self) -> StudyView:
        """Stop for good; the results stay."""
        return self._steer("cancel")

    def retry_failed(self) -> StudyView:
        """Give jobs that were given up another set of attempts."""
        return self._steer("retry-failed")

    def _steer(self, action: str) -> StudyView:
        view: StudyView = self._transport.call("POST", f"{self._path}/{action}")
        return view

    def dataset(self) -> pd.DataFrame:
        """Take the samples so far as a table, units in the column names. Needs pandas."""
        with self._transport.stream(f"{self._path}/dataset", "text/csv") as answer:
            frame = dataset.frame(answer)
            dataset.check_rows(answer, len(frame))
            return frame

    def dataset_arrow(self) -> pa.Table:
        """Take the samples so far as an Arrow table. Needs pyarrow.

        Each column has its `unit` in its metadata, and the table the study, its seed, its model and the
        solver's version in `table.schema.metadata`.
        """
        with self._transport.stream(f"{self._path}/dataset", "application/vnd.apache.parquet") as answer:
            table = dataset.table(answer)
            dataset.check_rows(answer, table.num_rows)
            return table

    def rows(self) -> Iterator[dict[str, Any]]:
        """Take the samples one by one, however many there are, with power per joint."""
        with self._transport.stream(f"{self._path}/dataset", "application/x-ndjson") as answer:
            count = 0
            for line in io.TextIOWrapper(answer, encoding="utf-8"):
                if not line.endswith("\n"):
                    break  # cut in its middle
                yield json.loads(line)
                count += 1
            dataset.check_rows(answer, count)

    def surrogate(self) -> SurrogateView:
        """Tell the training curve, also while it trains, and the errors of the network."""
        view: SurrogateView = self._transport.get(f"{self._path}/surrogate")
        return view

    @overload
    def predict(self, points: pd.DataFrame) -> pd.DataFrame: ...
    @overload
    def predict(self, points: Mapping[str, float]) -> Prediction: ...
    @overload
    def predict(self, points: Iterable[Mapping[str, float]]) -> list[Prediction]: ...

    def predict(self, points: Any) -> Any:
        """Ask the network for L+, D+, M+ and P+ anywhere in the study's box.

        One point is a dictionary of the ten parameters; an iterable of them gives a list. A table
        with these columns, such as the dataset or a part of it, gives a table with the same index.

        The surrogate is asked as it was trained: what refining flew near an optimum is not in it, so there
        `optimum()` knows better. Each answer has the surrogate's errors on strokes it has not seen as
        `test_rmse`, a table as `attrs["test_rmse"]`. Points outside the study's box are warned of.
        """
        if isinstance(points, Mapping):
            return self._predict([points])[0]
        if hasattr(points, "columns"):
            found = self._predict(points[list(PARAMETERS)].to_dict("records"))
            table = dataset.like(points, found, OUTPUTS)
            if found:
                table.attrs.update(by=found[0].by, test_rmse=found[0].test_rmse)
            return table
        return self._predict(list(points))

    def _predict(self, points: list[Mapping[str, float]]) -> list[Prediction]:
        found: list[Prediction] = []
        outside: list[dict[str, Any]] = []
        for start in range(0, len(points), _MOST_POINTS):
            body = {"points": points[start : start + _MOST_POINTS]}
            answer = self._transport.call("POST", f"{self._path}/surrogate/predictions", body)
            about = (answer.get("by"), answer.get("test_rmse"))
            found += [Prediction(scaled, *about) for scaled in answer["predictions"]]
            outside += answer.get("outside", [])
        if outside:
            names = sorted({name for point in outside for name in point["parameters"]})
            told = f"{len(outside)} of {len(points)} points are outside the study's box ({', '.join(names)})"
            warnings.warn(f"{told}: nothing was learnt there", stacklevel=3)
        return found

    def simulate(self, parameters: Mapping[str, float], *, wake: Wake | None = None) -> SimulationView:
        """Fly one stroke with the model of this study while you wait; see `Client.simulate`.

        Flown with the parameters of a sample it has the sample's means, to the last bit.
        """
        return fly(self._transport, parameters, wake, study=self.id)

    def model(self) -> dict[str, Any]:
        """Take the surrogate itself: its frame, and all numbers of its networks or gaussian process."""
        return cast("dict[str, Any]", self._transport.get(f"{self._path}/surrogate/model"))

    def onnx(self) -> bytes:
        """Take the surrogate as an ONNX model, from `parameters` to `means`, rows of doubles both.

        Not of a gaussian process, which has no such form: that is a `ProblemError`.
        """
        with self._transport.stream(f"{self._path}/surrogate/model", "application/onnx") as answer:
            return answer.read()

    def optima(self) -> list[Optimum]:
        """Read every optimum found so far."""
        found = self._transport.get(f"{self._path}/optimum")["optimisations"]
        return [Optimum.read(result) for result in found if result["parameters"]]

    def optimum(self, name: str | None = None) -> Optimum:
        """Read the optimum of this optimisation, of the first without a name."""
        answer = self._transport.get(f"{self._path}/optimum")
        asked = [result for result in answer["optimisations"] if name in {None, result["name"]}]
        if not asked:
            why = f"the study has no optimisation `{name}`" if name else "the study has no optimisations"
            raise ProblemError.of(Problem(f"{URN}unknown-optimisation", "Unknown optimisation", 404, why))
        if not asked[0]["parameters"]:
            why = f"`{asked[0]['name']}` has no optimum; the study is in state {answer['state']}"
            raise NotYetError(Problem(f"{URN}not-yet", "Not there yet", 404, why))
        return Optimum.read(asked[0])

    def optimise(
        self,
        name: str,
        *,
        method: Method | None = None,
        parameters: Mapping[str, float | tuple[float, float]] | None = None,
        **settings: float,
    ) -> dict[str, Any]:
        """Ask a finished study for a further optimum: nothing is sampled or trained again.

        `parameters` holds some at a value or narrows their bounds; `settings` are the other fields
        of an `[[optimisations]]` table, such as `starts` or `clearance_margin_mm`. Asked for twice
        it is found, not repeated. `wait()` returns when it is there, `optimum(name)` reads it.
        """
        body: dict[str, Any] = {"name": name, **settings}
        if method:
            body["method"] = method
        if parameters:
            body["parameters"] = dict(parameters)
        return cast("dict[str, Any]", self._transport.call("POST", f"{self._path}/optimisations", body))


def fly(
    transport: Transport, parameters: Mapping[str, float], wake: Wake | None, **source: Any
) -> SimulationView:
    """Have one stroke flown; `source` is a study or a model."""
    body = {"parameters": dict(parameters), "wake": wake, **source}
    return cast("SimulationView", transport.call("POST", "/v1/simulations", body))


def pages(transport: Transport, path: str, **query: Any) -> Iterator[Any]:
    """Read a list page after page, as its items are asked for."""
    cursor = None
    while True:
        page = transport.get(path, cursor=cursor, **query)
        yield from page["items"]
        cursor = page.get("next_cursor")
        if cursor is None:
            return
