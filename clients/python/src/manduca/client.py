"""A coordinator, and the studies it has."""

from __future__ import annotations

import json
import os
import tomllib
import uuid
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from manduca._http import Transport
from manduca.study import Study, fly, pages

if TYPE_CHECKING:
    from collections.abc import Iterator

    from manduca.views import DryRun, Parameters, SimulationView, StudyState, StudySummary, Wake, WorkerView

DEFAULT_URL = "http://127.0.0.1:8080"

StudySource = Mapping[str, Any] | str | os.PathLike[str]
"""A study as a dictionary, or the path of its TOML or JSON file."""


class Client:
    """A coordinator.

    Without `url` it is that of MANDUCA_COORDINATOR, else http://127.0.0.1:8080. `token`, or
    MANDUCA_TOKEN, is sent as `Authorization: Bearer`, and to this address alone.
    """

    def __init__(self, url: str | None = None, token: str | None = None, *, timeout_s: float = 60.0) -> None:
        """Check the address; nothing is sent yet."""
        url = url or os.environ.get("MANDUCA_COORDINATOR") or DEFAULT_URL
        self._transport = Transport(url, token or os.environ.get("MANDUCA_TOKEN"), timeout_s)

    @property
    def url(self) -> str:
        """Address of the coordinator."""
        return self._transport.url

    def submit(self, study: StudySource, *, idempotency_key: str | None = None) -> Study:
        """Submit a study.

        The same study under the same key is submitted once, so a script which gives one can be
        run again. Without a key every call makes a study of its own.
        """
        key = {"idempotency-key": idempotency_key or str(uuid.uuid4())}
        view = self._transport.call("POST", "/v1/studies", _read(study), key)
        return Study(self._transport, view["id"])

    def dry_run(self, study: StudySource) -> DryRun:
        """Say what a study would cost and what is wrong with it; nothing is stored."""
        answer: DryRun = self._transport.call("POST", "/v1/studies?dry_run=true", _read(study))
        return answer

    def study(self, study: str = "latest") -> Study:
        """Find a study by its id; `latest` is the one submitted last."""
        if study == "latest":
            newest = next(self.studies(), None)
            if newest is None:
                raise LookupError(f"{self.url} has no studies yet\n  -> submit one: client.submit('my.toml')")
            study = newest["id"]
        found = Study(self._transport, study)
        found.status()
        return found

    def studies(self, state: StudyState | None = None) -> Iterator[StudySummary]:
        """List studies, newest first, page after page as they are asked for."""
        return pages(self._transport, "/v1/studies", state=state)

    def workers(self) -> list[WorkerView]:
        """List the workers of the last hours, and whether they are alive."""
        answer: list[WorkerView] = self._transport.get("/v1/workers")
        return answer

    def simulate(
        self, parameters: Parameters, *, model: Mapping[str, Any] | None = None, wake: Wake | None = None
    ) -> SimulationView:
        """Fly one stroke while you wait: its means, and every step of its last stroke in `history`.

        `model` is as in a study, the default model without it; `wake` asks for the vortex rings of
        the `last` step, or of some steps of the last `stroke`. Nothing is stored.
        """
        return fly(self._transport, parameters, wake, model=model)

    def __repr__(self) -> str:
        """Tell the address, never the token."""
        return f"Client({self.url!r})"


def _read(study: StudySource) -> Mapping[str, Any]:
    if isinstance(study, Mapping):
        return study
    path = Path(study)
    text = path.read_text(encoding="utf-8")
    try:
        read: Any = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    if not isinstance(read, dict):
        raise ValueError(f"{path}: a study is an object with a name and sampling.samples")
    return read
