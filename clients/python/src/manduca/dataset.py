"""A dataset's CSV as a table of pandas or Arrow, read while it arrives."""

from __future__ import annotations

from typing import IO, TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd
    import pyarrow as pa

_TEXTS = ("outcome", "reason", "solver_version")
_UNITS = {"_hz": "Hz", "_deg": "degree", "_nm": "N m", "_n": "N", "_w": "W"}


def unit(column: str) -> str:
    """Tell the unit of a column by its name: `1` for scaled values, empty for texts and indices."""
    if column in {"sample", *_TEXTS}:
        return ""
    name = column.removesuffix("_se")
    return next((unit for ending, unit in _UNITS.items() if name.endswith(ending)), "1")


def frame(source: IO[bytes]) -> pd.DataFrame:
    """Read a table of pandas: every number as it was sent, missing means as NaN, no reason as ''."""
    try:
        import pandas as pd
    except ImportError as error:
        raise ImportError(_missing("pandas", "pandas")) from error
    # Before 3.1 many numbers lose their last bit by default; since then asking for it is deprecated.
    version = tuple(int(part) for part in pd.__version__.split(".")[:2])
    exact: Any = {"float_precision": "round_trip"} if version < (3, 1) else {}
    read: pd.DataFrame = pd.read_csv(source, dtype=dict.fromkeys(_TEXTS, str), **exact)
    return read.fillna({"reason": ""})


def table(source: IO[bytes]) -> pa.Table:
    """Read an Arrow table: missing means are null, units are in the fields' metadata."""
    try:
        import pyarrow as pa
        from pyarrow import csv
    except ImportError as error:
        raise ImportError(_missing("pyarrow", "arrow")) from error
    options = csv.ConvertOptions(column_types=dict.fromkeys(_TEXTS, pa.string()))
    read = csv.read_csv(source, convert_options=options)
    return read.cast(pa.schema([_field(pa, name) for name in read.column_names]))


def _field(pa: Any, name: str) -> Any:
    # By name, not by what is in it: a column without a value yet has its type all the same.
    if unit(name):
        return pa.field(name, pa.float64(), metadata={"unit": unit(name)})
    return pa.field(name, pa.string() if name in _TEXTS else pa.int64())


def like(points: pd.DataFrame, rows: Sequence[Any], columns: Sequence[str]) -> pd.DataFrame:
    """Make a table of rows with the index of another."""
    return type(points)(rows, index=points.index, columns=list(columns))


def _missing(library: str, extra: str) -> str:
    return f"this needs {library}\n  -> pip install 'manduca[{extra}]', or take `study.rows()`"
