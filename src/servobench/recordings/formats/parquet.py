"""Apache Parquet files: a table of columns, with units in its fields' metadata or in the columns' names."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, final

from servobench.recordings.formats import arrow_table
from servobench.recordings.formats.base import FORMATS
from servobench.recordings.formats.extras import format_errors
from servobench.recordings.recording import Recording

_ROWS = 65536  # that are decoded at once


@final
@FORMATS.member("parquet")
@dataclass(frozen=True, kw_only=True)
class Parquet:
    """Parquet files. Each column of numbers, time stamps or durations is a channel; a field `b` of a struct `a` is `a.b`.

    Time stamps count in s from the first one. A unit comes from the metadata of a column's field (`unit` or `units`), from a
    JSON object of units by column in the schema's metadata, or from the column's name.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".parquet", ".pq")
    written: ClassVar[tuple[str, ...]] = suffixes
    by_library: ClassVar[bool] = True

    def recognises(self, path: Path, head: bytes) -> bool:
        """Return whether a file begins like a Parquet file."""
        return head.startswith(b"PAR1")

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return the one recording in a file, of as many row groups as it has; raises `FormatError` where it can't be read.

        Raises `UsageError` where pyarrow isn't installed.
        """
        pa = arrow_table.pyarrow("pyarrow", path.name)
        pq = arrow_table.pyarrow("pyarrow.parquet", path.name)
        with format_errors(path.name, "Parquet"):
            file = pq.ParquetFile(pa.BufferReader(path.read_bytes()), pre_buffer=False)
            leaves = arrow_table.leaves(file.schema_arrow, path.name)
            wanted = [leaf for leaf in leaves if not leaf.skipped]
            arrow_table.check_size(file.metadata.num_rows, len(wanted))
            batches = list(
                file.iter_batches(batch_size=_ROWS, columns=[leaf.name for leaf in wanted], use_threads=False)
            )
        return (arrow_table.recording_in(batches, file.schema_arrow, path, "parquet"),)

    def write(self, recordings: tuple[Recording, ...], path: Path) -> None:
        """Write a recording with all its digits and all that it knows; raises `UsageError` for more than one."""
        pq = arrow_table.pyarrow("pyarrow.parquet", path.name)
        table = arrow_table.table_of(recordings, path.name)
        with path.open("wb") as file:
            # A dictionary of floats would take 0.0 and -0.0 for one.
            pq.write_table(table, file, compression="zstd", use_dictionary=False)
