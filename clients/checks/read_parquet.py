"""Reads the dataset as Parquet and as CSV with Arrow, and compares them."""

import sys

import pyarrow
from pyarrow import csv, parquet


def main(table: str, text: str) -> None:
    file = parquet.ParquetFile(table)
    data = file.read()
    texts = dict.fromkeys(("outcome", "reason", "solver_version"), pyarrow.string())
    options = csv.ConvertOptions(column_types=texts, null_values=[""], strings_can_be_null=True)
    same = csv.read_csv(text, convert_options=options)
    assert data.column_names == same.column_names
    for name in data.column_names:
        assert data[name].cast(same[name].type).to_pylist() == same[name].to_pylist(), name
    for field in data.schema:
        if pyarrow.types.is_floating(field.type):
            assert field.metadata[b"unit"], field.name
    facts = file.metadata.metadata
    for key in ("study", "seed", "solver_version", "model", "dataset_blake3"):
        assert facts[f"manduca.{key}".encode()], key
    print(f"Arrow: {data.num_rows} rows, {data.num_columns} columns, every number as in the CSV")


main(sys.argv[1], sys.argv[2])
