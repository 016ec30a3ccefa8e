"""The process from which the workers of a fleet are forked imports all that it takes to identify a recording and keep its row."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pandas
import pyarrow.parquet

from tests.fleet.killed import identify_row_by_row
from tests.fleet.motors import SETTINGS, write_fleet

__all__ = ["identify_row_by_row", "pandas", "pyarrow"]

with tempfile.TemporaryDirectory() as folder:
    for name in write_fleet(Path(folder), 1):
        SETTINGS.identify(Path(folder) / name)
