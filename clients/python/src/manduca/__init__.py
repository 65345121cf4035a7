"""Client of manduca, which finds the hovering strokes of a flapping wing that cost the least power.

    >>> import manduca
    >>> study = manduca.Client().submit("quick.toml")
    >>> study.wait()
    >>> study.dataset()
    >>> print(study.optimum())

Names and units are those of the REST interface: `frequency_hz`, `lift_n`, `power_w`, and without
a unit the scaled lift L+, drag D+, pitch_moment M+ and power P+.
"""

from manduca.client import Client
from manduca.errors import (
    FieldFault,
    ForeignAnswerError,
    ManducaError,
    NotYetError,
    Problem,
    ProblemError,
    StudyEndedError,
    UnreachableError,
    WaitTimeoutError,
    WrongStateError,
)
from manduca.optimum import Optimum
from manduca.study import Study
from manduca.views import OUTPUTS, PARAMETERS

__all__ = [
    "OUTPUTS",
    "PARAMETERS",
    "Client",
    "FieldFault",
    "ForeignAnswerError",
    "ManducaError",
    "NotYetError",
    "Optimum",
    "Problem",
    "ProblemError",
    "Study",
    "StudyEndedError",
    "UnreachableError",
    "WaitTimeoutError",
    "WrongStateError",
]
