"""What can go wrong, each with what to do next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from manduca.views import StudyView

URN = "urn:manduca:problem:"
PASSING = frozenset({429, 502, 503, 504})

_ADVICE = {
    "invalid-study": "correct the fields named; `client.dry_run(study)` checks without storing",
    "invalid-request": "correct the fields named; nothing was done",
    "invalid-query": "correct the arguments named",
    "idempotency-key-reused": "use another idempotency_key, or the study it was first used with",
    "unknown-study": "`client.studies()` lists those this coordinator has",
    "unknown-optimisation": "`study.optima()` lists those of the study",
    "not-yet": "`study.wait()` returns when it is there; `study.status()` tells how far it is",
    "wrong-state": "`study.status()['state']` tells where it is",
    "body-too-large": "send less at once",
    "unavailable": "try again; if it stays so, look at the coordinator's log",
    "internal": "look at the coordinator's log",
    "no-route": "is this the address of a coordinator, and is it as new as this client?",
}
_ADVICE_BY_STATUS = {
    401: "give a token: Client(url, token=...) or the environment variable MANDUCA_TOKEN",
    403: "this token does not allow it",
    404: "is this the address of a coordinator?",
}


class ManducaError(Exception):
    """Any failure this client reports."""

    @property
    def passing(self) -> bool:
        """Whether the same call may succeed a little later."""
        return False


@dataclass(frozen=True)
class FieldFault:
    """One field at fault: a JSON pointer into what was sent, and why."""

    pointer: str
    detail: str


@dataclass(frozen=True)
class Problem:
    """A refusal as the coordinator words it (RFC 9457).

    An answer of something in between, such as a proxy, is a `ForeignAnswerError`, of the type `about:blank`.
    """

    type: str
    title: str
    status: int
    detail: str
    errors: tuple[FieldFault, ...] = ()

    @classmethod
    def read(cls, document: Mapping[str, Any], status: int) -> Problem:
        """Read a problem document, leniently: it may come from another program."""
        faults = document.get("errors")
        listed = [fault for fault in faults if isinstance(fault, dict)] if isinstance(faults, list) else []
        return cls(
            type=str(document.get("type", "about:blank")),
            title=str(document.get("title", "")),
            status=status,
            detail=str(document.get("detail", "")),
            errors=tuple(FieldFault(str(f.get("pointer", "")), str(f.get("detail", ""))) for f in listed),
        )

    @property
    def slug(self) -> str:
        """Last part of the type, such as `invalid-study`."""
        return self.type.removeprefix(URN)

    @property
    def advice(self) -> str:
        """What to do next; empty where there is nothing to say."""
        return _ADVICE.get(self.slug, _ADVICE_BY_STATUS.get(self.status, ""))

    def __str__(self) -> str:
        """Sentence, faults and advice, one a line."""
        lines = [f"{self.detail or self.title or 'refused'} ({self.status} {self.slug})"]
        lines += [f"  {fault.pointer or '/'}: {fault.detail}" for fault in self.errors]
        if self.advice:
            lines.append(f"  -> {self.advice}")
        return "\n".join(lines)


class ProblemError(ManducaError):
    """The coordinator refused; `problem` has its document."""

    def __init__(self, problem: Problem) -> None:
        """Carry the document."""
        super().__init__(str(problem))
        self.problem = problem

    @property
    def passing(self) -> bool:
        """Whether the coordinator, or a proxy in front of it, asks for patience."""
        return self.problem.status in PASSING

    @staticmethod
    def of(problem: Problem) -> ProblemError:
        """Make the exception of this kind of problem."""
        return {"not-yet": NotYetError, "wrong-state": WrongStateError}.get(problem.slug, ProblemError)(
            problem
        )


class NotYetError(ProblemError):
    """What was asked for does not exist yet: no network, no optimum."""


class WrongStateError(ProblemError):
    """The study's state does not allow this."""


class UnreachableError(ManducaError):
    """No coordinator answers, or its answer broke off."""

    @property
    def passing(self) -> bool:
        """A coordinator may be restarted meanwhile."""
        return True


class ForeignAnswerError(ProblemError, UnreachableError):
    """Something else than a coordinator answered: a proxy, a login page, another service.

    `problem` is of the type `about:blank` and has the status. What a stranger says is nothing about
    the call, so it may be made again.
    """

    def __init__(self, url: str, status: int, said: str) -> None:
        """Say who answered what."""
        super().__init__(Problem("about:blank", said, status, ""))
        self.args = (
            f"the answer of {url} is not from a manduca coordinator: {status} {said}"
            "\n  -> is this a coordinator's address? a proxy or a login page on the way may have answered",
        )

    @property
    def passing(self) -> bool:
        """The coordinator itself may answer a little later."""
        return True


class WaitTimeoutError(ManducaError, TimeoutError):
    """A study was not done in the time given; it goes on."""


class StudyEndedError(ManducaError):
    """A study waited for failed or was cancelled; `view` has its last state."""

    def __init__(self, view: StudyView) -> None:
        """Carry the view."""
        why = f": {view['failure']}" if view["failure"] else ""
        advice = "`study.retry_failed()` tries again what was given up" if view["state"] == "failed" else ""
        super().__init__(
            f"study {view['id']} {_ENDED[view['state']]}{why}" + (f"\n  -> {advice}" if advice else "")
        )
        self.view = view


_ENDED = {"failed": "has failed", "cancelled": "was cancelled"}
