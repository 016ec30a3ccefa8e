"""The rows that there are so far: Parquet files that are whole or absent, in a folder that one command writes to at a time."""

from __future__ import annotations

import json
import os
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from servobench.core.errors import FormatError, StorageError, UsageError
from servobench.fleet.row import COUNTS, LISTS, TEXTS, Row
from servobench.fleet.source import SETTINGS_SCHEMA
from servobench.recordings.native.lease import hold

_PART = re.compile(r"part-(\d{6})\.parquet")
_MOST_ROWS = 500
_LONGEST = 5.0  # s that a row waits to be written: what a kill may cost
_UNFINISHED = ".unfinished"


@dataclass(frozen=True)
class _Part:
    """A part to be written at `path`: the rows `before`, which are there already, and new `rows`."""

    path: Path
    before: list[Row]
    rows: list[Row]


class Results:
    """A folder with the results of a fleet, held by this process as long as the context lasts.

    `settings` are those that the rows depend on. Raises `UsageError` where the folder holds something else, results of other
    settings, or is written to by another command, and `StorageError` where it can't be written.
    """

    def __init__(
        self, folder: Path, settings: Mapping[str, Any], *, now: Callable[[], float] = time.monotonic
    ) -> None:
        self.folder = folder
        self._settings = json.loads(json.dumps({"schema": SETTINGS_SCHEMA, **settings}))
        self._now = now
        self._lock: BinaryIO | None = None
        self._open: _Part | None = None
        self._oldest = 0.0

    def __enter__(self) -> Results:
        """Take the folder, and remove what a killed command left unfinished."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._check_content()
            self._take()
            (self.folder / "parts").mkdir(exist_ok=True)
            for path in (self.folder / "parts").glob(f"*{_UNFINISHED}"):
                path.unlink()
            self._check_settings()
        except FileExistsError:
            raise UsageError(f"`out={self.folder}` is a file; expected a folder for the results") from None
        except OSError as error:
            self._release()
            if isinstance(error, StorageError):
                raise
            raise StorageError(f"{self.folder} can't be written: {error.strerror or error}") from error
        except BaseException:
            self._release()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        """Write what isn't written yet, and let go of the folder."""
        try:
            self.flush()
        finally:
            self._release()

    def stamps(self) -> dict[str, str]:
        """Return the stamp of each file that has a row, by its name."""
        return {
            name: stamp
            for path in part_files(self.folder)
            for name, stamp in zip(*read_columns(path, ("file", "stamp")), strict=True)
        }

    def unfit(self) -> set[str]:
        """Return the files that have a row without a result."""
        return {
            name
            for path in part_files(self.folder)
            for name, outcome in zip(*read_columns(path, ("file", "outcome")), strict=True)
            if outcome != "identified"
        }

    def remove(self, names: Iterable[str]) -> None:
        """Remove the rows of some files, part by part."""
        self.flush()
        gone = set(names)
        for path in part_files(self.folder) if gone else ():
            if not gone.isdisjoint(read_columns(path, ("file",))[0]):
                rows = [row for row in read_rows(path) if row["file"] not in gone]
                if rows:
                    _write(path, rows)
                else:
                    path.unlink()

    def add(self, row: Row) -> None:
        """Take a row, and write a part where there are enough, or the first of them has waited for some seconds."""
        now = self._now()
        self._oldest = self._oldest if self._open else now
        self._append(row)
        if self._is_full() or now - self._oldest >= _LONGEST:
            self.flush()

    def replace(self, row: Row, has_one: bool) -> None:
        """Take a row, in the place of an earlier one of its file if that `has_one`, and write it at once."""
        if has_one:
            self.remove([row["file"]])
        self._append(row)
        self.flush()

    @property
    def is_empty(self) -> bool:
        """Whether there are no rows yet."""
        return not part_files(self.folder)

    def flush(self) -> None:
        """Write the rows that aren't written yet: into the last part while that is small, otherwise into a new one.

        Ctrl-C between the writing and the end of this leads to the same again, into the same part: no row is there twice.
        """
        if self._open:
            _write(self._open.path, self._open.before + self._open.rows)
        self._open = None

    def _append(self, row: Row) -> None:
        if self._open is None:
            self._open = self._last_part()
        self._open.rows.append(row)

    def _is_full(self) -> bool:
        return self._open is not None and len(self._open.rows) >= _MOST_ROWS

    def _last_part(self) -> _Part:
        """The last part while that is small, otherwise a new one."""
        last = next(reversed(part_files(self.folder)), None)
        before = read_rows(last) if last is not None and _row_count(last) < _MOST_ROWS else []
        number = int(last.stem[-6:]) if last is not None else 0
        return _Part(
            path=self.folder / "parts" / f"part-{number + (not before):06}.parquet", before=before, rows=[]
        )

    def _check_content(self) -> None:
        if not (self.folder / "settings.json").exists() and any(
            path.name not in (".lock", "parts", f"settings.json{_UNFINISHED}")
            for path in self.folder.iterdir()
        ):
            raise UsageError(
                f"`out={self.folder}` holds something other than the results of a fleet; give a new folder"
            )

    def _take(self) -> None:
        self._lock = (self.folder / ".lock").open("ab")
        if not hold(self._lock):
            raise UsageError(
                f"`out={self.folder}`: another command is writing there; wait until it ends, or stop it"
            )

    def _release(self) -> None:
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _is_of_use(self) -> bool:
        """Whether any row has a result: if none has, the settings were wrong and may be corrected."""
        return any("identified" in read_columns(path, ("outcome",))[0] for path in part_files(self.folder))

    def _check_settings(self) -> None:
        path = self.folder / "settings.json"
        before = settings_in(self.folder) if path.exists() else {}
        if before == self._settings:
            return
        if self._is_of_use():
            changed = _differences(before, self._settings)
            raise UsageError(
                f"`out={self.folder}` holds results of other settings ({'; '.join(changed)}). Rows of both in one table "
                "couldn't be compared: give a new folder, or the same settings"
            )
        for part in part_files(self.folder):
            part.unlink()
        write_whole(path, json.dumps(self._settings, indent=1, ensure_ascii=False).encode("utf-8"))


def settings_in(folder: Path) -> dict[str, Any]:
    """Return the settings of the results in a folder; raises `FormatError` where it holds none."""
    path = folder / "settings.json"
    try:
        settings = json.loads(path.read_text(encoding="utf-8"))
    except OSError:
        raise FormatError(
            f"{folder} holds no results of a fleet; expected the folder that `servobench fleet SOURCE --out` wrote"
        ) from None
    except ValueError as error:
        raise FormatError(f"{path} is damaged: {error}; give a new folder") from None
    if not isinstance(settings, dict) or settings.get("schema") != SETTINGS_SCHEMA:
        raise FormatError(f"{path} isn't of the schema {SETTINGS_SCHEMA}; give a new folder")
    return settings


def part_files(folder: Path) -> list[Path]:
    """Return the parts of the results in a folder, in their order."""
    return sorted(path for path in (folder / "parts").glob("part-*.parquet") if _PART.fullmatch(path.name))


def rows_in(folder: Path) -> Iterator[Row]:
    """Return all rows, one part in memory at a time."""
    for path in part_files(folder):
        yield from read_rows(path)


def read_rows(path: Path) -> list[Row]:
    """Return the rows of a part, each without the columns that it leaves empty; raises `FormatError` where it can't be read."""
    rows = _table(path, None).to_pylist()
    return [{name: value for name, value in row.items() if value is not None} for row in rows]


def _row_count(path: Path) -> int:
    from servobench.recordings.formats.arrow_table import pyarrow

    count: int = pyarrow("pyarrow.parquet", path.name).read_metadata(path).num_rows
    return count


def read_columns(path: Path, names: Iterable[str]) -> list[list[Any]]:
    """Return some columns of a part; raises `FormatError` where it can't be read."""
    table = _table(path, list(names))
    return [table[name].to_pylist() for name in names]


def _table(path: Path, columns: list[str] | None) -> Any:
    from servobench.recordings.formats.arrow_table import pyarrow

    pa, parquet = pyarrow("pyarrow", path.name), pyarrow("pyarrow.parquet", path.name)
    try:
        return parquet.ParquetFile(path).read(columns=columns, use_threads=False)
    except (OSError, pa.ArrowException, KeyError) as error:
        raise FormatError(
            f"{path} is damaged: {(str(error).splitlines() or ['no details'])[0]}. Delete it, and its files are "
            "identified again"
        ) from error


def arrow_schema(names: Iterable[str], texts: Iterable[str]) -> Any:
    """Return the Arrow schema of some columns; `texts` are those that come from the names of files."""
    from servobench.recordings.formats.arrow_table import pyarrow

    pa = pyarrow("pyarrow", "results of a fleet")
    own = set(texts)

    def kind(name: str) -> Any:
        if name in LISTS:
            return pa.list_(pa.string())
        if name in COUNTS:
            return pa.int64()
        if name in {"outlier"}:
            return pa.bool_()
        is_text = name in TEXTS or name in own or name.endswith(("_unit", "_state"))
        return pa.string() if is_text else pa.float64()

    return pa.schema([(name, kind(name)) for name in names])


def columns_of(rows: Iterable[Row]) -> dict[str, bool]:
    """Return the names of all columns in some rows, in the order in which they come, and whether they hold texts."""
    columns: dict[str, bool] = {}
    for row in rows:
        for name, value in row.items():
            columns[name] = columns.get(name, False) or isinstance(value, str)
    return columns


def _write(path: Path, rows: list[Row]) -> None:
    """Write a part: all of it under another name, then its own."""
    from servobench.recordings.formats.arrow_table import pyarrow

    pa, parquet = pyarrow("pyarrow", path.name), pyarrow("pyarrow.parquet", path.name)
    columns = columns_of(rows)
    schema = arrow_schema(columns, [name for name, is_text in columns.items() if is_text])
    table = pa.Table.from_pylist(rows, schema=schema)
    sink = pa.BufferOutputStream()
    parquet.write_table(table, sink, compression="zstd")
    write_whole(path, sink.getvalue().to_pybytes())


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that it is whole or as before, even if the machine stops; raises `StorageError` where it can't be."""
    beside = path.with_name(f"{path.name}{_UNFINISHED}")
    try:
        with beside.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
        with suppress(OSError):  # a folder can't be synced everywhere
            number = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(number)
            finally:
                os.close(number)
    except OSError as error:
        with suppress(OSError):
            beside.unlink()
        raise StorageError(f"{path} can't be written: {error.strerror or error}") from error


def _differences(before: Mapping[str, Any], now: Mapping[str, Any], inside: str = "") -> list[str]:
    """The differences between two settings, each as `name: before, now after`."""
    differences = []
    for name in sorted({*before, *now}):
        old, new = before.get(name), now.get(name)
        if isinstance(old, dict) and isinstance(new, dict):
            differences += _differences(old, new, f"{inside}{name} ")
        elif old != new:
            differences.append(f"{inside}{name} was {_short(old)} and is now {_short(new)}")
    return differences


def _short(value: object) -> str:
    text = "not given" if value in (None, "", {}, []) else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
