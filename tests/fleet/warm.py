"""The process from which the workers of a fleet are forked imports all that identifying a recording needs."""

from __future__ import annotations

import tempfile
from pathlib import Path

from tests.fleet.motors import SETTINGS, write_fleet

with tempfile.TemporaryDirectory() as folder:
    for name in write_fleet(Path(folder), 1):
        SETTINGS.identify(Path(folder) / name)
