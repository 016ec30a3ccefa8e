"""The store of each row's runs, so that a long bench continues from where it stopped."""

import hashlib
import json
import os
from pathlib import Path
from typing import Any

from accuracy_parts.rows import Row

Run = dict[str, Any]
_SIMULATORS = ("kernels", "inputs", "motor", "plants", "bounds", "runs")


def fingerprint(row: Row) -> str:
    """Return what tells whether kept runs of a row are still right: the package's code, the simulators', and the row itself."""
    import servobench

    package = Path(servobench.__file__).parent
    here = Path(__file__).parent
    digest = hashlib.sha256(repr(row).encode())
    for path in [*sorted(package.rglob("*.py")), *(here / f"{name}.py" for name in _SIMULATORS)]:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def kept(folder: Path, row: Row, code: str) -> list[Run]:
    """Return the runs of a row that were kept, in their order; none where code or row has changed since."""
    path = folder / f"{row.name}.json"
    if not path.exists():
        return []
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
    except ValueError:  # a file that was cut off; its runs are done again
        return []
    return list(stored["runs"]) if stored["code"] == code else []


def keep(folder: Path, row: Row, code: str, runs: list[Run]) -> None:
    """Write the runs of a row, whole or not at all."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{row.name}.json"
    part = path.with_suffix(".part")
    runs = sorted(runs, key=lambda run: run["run"])
    part.write_text(json.dumps({"row": row.name, "code": code, "runs": runs}), encoding="utf-8")
    os.replace(part, path)
