"""A worker's task: a file in, a row out, whatever the file is."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path

from numpy.linalg import LinAlgError

from servobench.core.errors import MissingInformation, ServobenchError
from servobench.fleet.row import CRASHED, UNUSABLE, Row, result_row, row_of_failure
from servobench.fleet.settings import Settings
from servobench.fleet.source import Item, Source

_SENTENCES = 4  # of an explanation: the differences and the most likely cause


def identify_item(source: Source, settings: Settings, item: Item, columns: Mapping[str, str]) -> Row:
    """Return the row of a recording, with the CPU time that it took [s]; what goes wrong with it is its reason."""
    began = time.process_time()
    outcome, reason, copy = UNUSABLE, "", ""
    row: Row | None = None
    try:
        with source.local(item) as path:
            copy = str(path)
            row = result_row(item, columns, settings.identify(path)[1])
    except MissingInformation as error:
        reason = "; ".join(error.missing)
    except ServobenchError as error:
        reason = " ".join(str(error).split())
    except OSError as error:
        reason = f"it can't be read: {error.strerror or error}"
    except MemoryError:
        outcome, reason = CRASHED, "there isn't enough memory for it"
    except (Exception, SystemExit) as error:  # one file must not end a run of thousands
        first_line = (str(error).splitlines() or ["no details"])[0]
        outcome, reason = CRASHED, f"a fault of servobench: {type(error).__name__}: {first_line}"
    if row is None:
        # A message names the file where it was read, which for a store is a folder that is gone.
        row = row_of_failure(item, columns, outcome, reason.replace(copy, item.text) if copy else reason)
    return row | {"cpu_seconds": time.process_time() - began}


def write_report(
    source: Source, settings: Settings, item: Item, middle: Mapping[str, float], page: Path, command: str
) -> tuple[str, ...]:
    """Write the report of a recording, unless it is there, and return in sentences why it differs from `middle`.

    `middle` are the fleet's gain, time constant, both or neither. The sentences are those of `why`; none where there is
    nothing to explain, or the data don't tell these parameters.
    """
    from servobench.identification.reconciliation.reconcile import explain
    from servobench.report.document import Report

    with source.local(item) as path:
        evidence, result = settings.identify(path)
    if not page.exists():
        Report([part.recording for part in evidence], result, command=command).write(page)
    if not middle or result.fit is None or not set(middle) <= set(result.fit.model.names):
        return ()
    try:
        return explain(result, middle).sentences[:_SENTENCES]
    except (ServobenchError, ArithmeticError, LinAlgError) as error:
        # Such as data without any noise, which leave a matrix of uncertainties without an inverse.
        return (f"The cause can't be determined: {error}.",)
