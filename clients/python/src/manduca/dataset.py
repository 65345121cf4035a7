"""A dataset as a table of pandas, from CSV read while it arrives, or of Arrow, from Parquet."""

from __future__ import annotations

from typing import IO, TYPE_CHECKING, Any

from manduca.errors import UnreachableError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from http.client import HTTPResponse

    import pandas as pd
    import pyarrow as pa

_TEXTS = ("outcome", "reason", "solver_version")


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
        from pyarrow import parquet
    except ImportError as error:
        raise ImportError(_missing("pyarrow", "arrow")) from error
    # The end of such a file says where everything is: it is read whole, some 150 bytes a sample.
    file = parquet.ParquetFile(pa.BufferReader(source.read()))
    facts = {key: value for key, value in file.metadata.metadata.items() if key != b"ARROW:schema"}
    return file.read().replace_schema_metadata(facts)


def check_rows(answer: HTTPResponse, rows: int) -> None:
    """Raise where fewer rows came than the coordinator announced.

    A connection that breaks off is an error by itself, but a proxy on the way may end a broken answer
    as if it were whole.
    """
    announced = answer.headers.get("manduca-rows", "")
    if announced.isdecimal() and rows < int(announced):
        raise UnreachableError(f"the dataset broke off: {rows} of {announced} rows came\n  -> ask again")


def like(points: pd.DataFrame, rows: Sequence[Any], columns: Sequence[str]) -> pd.DataFrame:
    """Make a table of rows with the index of another."""
    return type(points)(rows, index=points.index, columns=list(columns))


def _missing(library: str, extra: str) -> str:
    return f"this needs {library}\n  -> pip install 'manduca[{extra}]', or take `study.rows()`"
