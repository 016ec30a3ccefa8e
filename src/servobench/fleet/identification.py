"""Identify every recording of a source into a folder, going on where an earlier command was stopped."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from servobench.core.errors import UsageError
from servobench.core.processors import processors
from servobench.fleet.name_pattern import NamePattern
from servobench.fleet.parts import Results
from servobench.fleet.pool import Cluster, Died, Processes
from servobench.fleet.row import CRASHED, Row, row_of_failure
from servobench.fleet.settings import Settings
from servobench.fleet.source import Item, Source, list_items, source_at
from servobench.fleet.worker import identify_item

PATIENCE = "10s"
"""Time for a scheduler to answer."""


@dataclass(frozen=True, kw_only=True)
class Progress:
    """The progress: files that this command has done, those that it had to do, and those that were done before."""

    done: int
    due: int
    """Files that this command had to do."""
    before: int


@dataclass(frozen=True, kw_only=True)
class Summary:
    """A command's summary: files identified now and before, and files that are no recordings."""

    identified: int
    before: int
    others: tuple[str, ...]
    """Files of the source that are no recordings."""


def identify_fleet(
    place: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    pattern: str | None = None,
    settings: Settings | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    retry: bool = False,
    progress: Callable[[Progress], None] = lambda _: None,
) -> Summary:
    """Identify every recording in a folder, or at an address of an object store, and keep a row of each in the folder `out`.

    Files that have a row already, and haven't changed since, are left as they are; with `retry` those without a result are tried
    again. `pattern` makes columns of the files' names (see `NamePattern`). `workers` is the number of processes (without it,
    one for each processor), `scheduler` the address of a Dask cluster in place of them. The rows don't depend on either, but
    for `cpu_seconds`. A script that calls this has to do it below `if __name__ == "__main__":`.

    Raises `UsageError` where there are no recordings, the folder holds results of other settings, or another command writes to
    it; `StorageError` where it can't be written.
    """
    settings = settings or Settings()
    names = NamePattern(pattern) if pattern is not None else None
    folder = Path(out)
    source = source_at(place, without=folder)
    listing = list_items(source, names)
    with results_of(source, folder, pattern, settings) as results:
        stamps = results.stamps()
        again = results.unfit() if retry else set()
        due = [each for each in listing.items if stamps.get(each.text) != each.stamp or each.text in again]
        results.remove({each.text for each in due} & set(stamps))
        progress(Progress(done=0, due=len(due), before=len(listing.items) - len(due)))
        work = partial(identify, source, settings, names)
        for done, row in enumerate(rows_of(due, work, names, workers, scheduler), 1):
            results.add(row)
            progress(Progress(done=done, due=len(due), before=len(listing.items) - len(due)))
    return Summary(identified=len(due), before=len(listing.items) - len(due), others=listing.others)


def results_of(source: Source, folder: Path, pattern: str | None, settings: Settings) -> Results:
    """Return the folder of the results, which is taken where its context is entered; raises what `identify_fleet` does."""
    _check_apart(source, folder)
    settings.check()
    return Results(folder, {"source": source.address, "pattern": pattern, **settings.to_dict()})


def identify(source: Source, settings: Settings, pattern: NamePattern | None, item: Item) -> Row:
    """Return the row of a recording."""
    return identify_item(source, settings, item, columns_in(pattern, item))


def columns_in(pattern: NamePattern | None, item: Item) -> dict[str, str]:
    """Return the columns that a file's name gives; none without a pattern."""
    return (pattern.columns(item.name) or {}) if pattern is not None else {}


def rows_of(
    items: list[Item],
    work: Callable[[Item], Row],
    pattern: NamePattern | None,
    workers: int | None,
    scheduler: str | None,
) -> Iterator[Row]:
    """Return the row of each item in their order, as they come."""
    if not items:
        return
    count = workers or processors()
    with pool_of(work, min(count, len(items)), scheduler) as pool:
        for item, row in pool.results(items):
            yield row_or_reason(item, pattern, row)


def row_or_reason(item: Item, pattern: NamePattern | None, outcome: Row | Died) -> Row:
    """Return a row, or that of a recording whose process died."""
    return (
        row_of_failure(item, columns_in(pattern, item), CRASHED, outcome.reason)
        if isinstance(outcome, Died)
        else outcome
    )


@contextmanager
def pool_of(work: Callable[[Any], Any], count: int, scheduler: str | None) -> Iterator[Any]:
    """Return the workers: processes of this machine, or those of a Dask cluster; raises `UsageError` without them."""
    if scheduler is None:
        with Processes(work, count) as processes:
            yield processes
        return
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise UsageError(
            f"`scheduler={scheduler}` needs Dask; python -m pip install 'servobench[fleet]'"
        ) from None
    try:
        client = distributed.Client(scheduler, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        why = (str(error).splitlines() or ["no reason given"])[0]
        raise UsageError(
            f"`scheduler={scheduler}`: nothing answers there ({why}); start one with `dask scheduler`, and workers with "
            "`dask worker ADDRESS`"
        ) from error
    with client:
        threads = sum(client.nthreads().values())
        if not threads:
            raise UsageError(f"`scheduler={scheduler}` has no workers; start some with `dask worker ADDRESS`")
        yield Cluster(work, partial(client.submit, pure=False), ahead=4 * threads)


def _check_apart(source: Source, folder: Path) -> None:
    """Raise `UsageError` where the results would lie among the recordings themselves, or the recordings among the results."""
    if "://" in source.address:
        return
    if Path(source.address) == folder.resolve():
        raise UsageError(
            f"`out={folder}` is the folder with the recordings; give the results a folder of their own"
        )
    if folder.resolve() in Path(source.address).parents:
        raise UsageError(f"`out={folder}` holds the recordings; give the results a folder of their own")
