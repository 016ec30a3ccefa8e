"""A folder of recordings for the tests of a fleet, and what is compared of its rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from servobench.fleet.parts import rows_in
from servobench.fleet.settings import Settings

SETTINGS = Settings(options={"output": "speed:rad/s", "chain": "none"})
PATTERN = "{line}/{serial}_{date}.csv"


def write_motor(file: Path, gain: float) -> None:
    """Write a recording of a motor of that gain and 0.1 s: its speed, every 5 ms."""
    t = np.arange(0, 4, 0.005)
    u = np.where(t % 1.3 < 0.6, 2.0, -1.5)
    speed = np.zeros(len(t))
    decay = np.exp(-0.05)
    for k in range(len(t) - 1):
        speed[k + 1] = decay * speed[k] + (1 - decay) * gain * u[k]
    rows = "".join(f"{x:.3f},{v:g},{w:.6f}\n" for x, v, w in zip(t, u, speed, strict=True))
    file.write_text(f"t,voltage,speed\n{rows}", encoding="utf-8")


def write_fleet(folder: Path, count: int, *, seed: int = 1, sd: float = 0.5) -> list[str]:
    """Write recordings of motors of 20 ± sd rad/(s·V) on two lines, and return their names."""
    random = np.random.default_rng(seed)
    names = []
    for serial in range(count):
        line = folder / f"line{serial % 2}"
        line.mkdir(parents=True, exist_ok=True)
        name = f"{serial:04}_2026-11-{1 + serial % 28:02}.csv"
        write_motor(line / name, float(random.normal(20, sd)))
        names.append(f"line{serial % 2}/{name}")
    return sorted(names)


def comparable(results: Path) -> dict[str, dict[str, Any]]:
    """The rows by file, without the time they took; a file with two rows fails."""
    found: dict[str, dict[str, Any]] = {}
    for row in rows_in(results):
        assert row["file"] not in found, row["file"]
        found[row["file"]] = {name: value for name, value in row.items() if name != "cpu_seconds"}
    return found
