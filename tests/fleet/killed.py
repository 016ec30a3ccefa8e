"""A command that is killed, as a fork of the process that tests/fleet/warm.py prepares: its first moments are work already."""

from __future__ import annotations

from multiprocessing import get_all_start_methods, get_context
from pathlib import Path

from servobench.fleet import parts, pool
from servobench.fleet.identification import identify_fleet
from tests.fleet.motors import SETTINGS


def identify_row_by_row(stand: Path, out: Path) -> None:
    """Identify a fleet by one worker, with a part for each row: as many moments of writing as there can be."""
    parts._LONGEST = 0.0
    if "fork" in get_all_start_methods():
        pool.get_context = lambda _: get_context("fork")  # type: ignore[attr-defined, assignment]
    identify_fleet(stand, out, settings=SETTINGS, workers=1)
