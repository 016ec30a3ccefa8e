"""Recordings and results with values that no motor has, given to the commands; run as a program it reports what goes wrong.

A process of its own, in which a warning is an error.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
import time
import warnings
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from servobench.cli import main
from servobench.core.channels import Array, Channel
from servobench.recordings.formats.base import save
from servobench.recordings.recording import Recording, Series, Source

ENDINGS = (".csv", ".mat", ".mcap", ".parquet", ".arrow")
OUTCOMES = (0, 2, 3)  # a result; wrong usage, or a file that can't be used; refused
_SIZES = (
    1e308,
    -1e308,
    1.7e308,
    1e300,
    1e200,
    1e155,
    1e100,
    1e30,
    1e-30,
    1e-100,
    1e-160,
    1e-300,
    5e-324,
    2.0**63,
    2.0**53,
)
_UNITS = ("rad", "deg/s", "counts", "rad/s")


def _voltage(random: np.random.Generator, n: int) -> Array:
    return np.repeat(random.choice([1.0, 2.0, 3.0], n // 20 + 1), 20)[:n]


def _motor(u: Array, step: float, *, position: bool) -> Array:
    """The speed of a first-order motor, or its position, by Euler's rule: what is hurt must be worth something."""
    speed = np.zeros(len(u))
    for k in range(1, len(u)):
        speed[k] = speed[k - 1] + min(step / 0.1, 1.0) * (20 * u[k - 1] - speed[k - 1])
    return np.cumsum(speed) * step if position else speed


def _hurt(x: Array, random: np.random.Generator) -> Array:
    """A column with extremes: scaled, in single places, constant, or of nothing else."""
    size = float(random.choice(_SIZES))
    x = x.copy()
    match int(random.integers(0, 8)):
        case 0:
            return np.clip(x, -1, 1) * size
        case 1:
            x[random.integers(0, len(x), 3)] = size
        case 2:
            x[random.integers(0, len(x), 3)] = random.choice([np.inf, -np.inf, np.nan, size], 3)
        case 3:
            x[:] = size
        case 4:
            x = random.choice([size, -size, 0.0, 1.0], len(x))
        case 5:
            x[-1], x[0] = size, -size
        case 6:
            x += size
        case _:
            x[:] = random.choice([0.0, np.nan, np.inf])
    return x


def recording(seed: int) -> Recording:
    """Return a recording of a motor of which one to three of time, input and output are hurt."""
    random = np.random.default_rng(seed)
    n, step = (
        int(random.choice([2, 3, 30, 400])),
        float(random.choice([0.01, 0.01, 0.01, 1e-300, 1e-12, 1e12, 1e300])),
    )
    unit = str(random.choice(_UNITS))
    u = _voltage(random, n)
    columns = {"t": step * np.arange(n), "u": u, "y": _motor(u, 0.01, position=unit in ("rad", "counts"))}
    with np.errstate(all="ignore"):
        for name in random.choice(list(columns), int(random.integers(1, 4)), replace=False):
            columns[str(name)] = _hurt(columns[str(name)], random)
        if not np.isfinite(columns["t"]).all() and random.random() < 0.5:
            columns["t"] = np.nan_to_num(columns["t"])
    series = tuple(
        Series(channel=Channel(name=name, unit=symbol), values=columns[name], t=columns["t"])
        for name, symbol in (("u", "V"), ("y", unit))
    )
    return Recording(name="extreme", series=series, source=Source(name="extreme"))


def commands(file: Path, folder: Path, unit: str) -> dict[str, list[str]]:
    """Return the command lines that a file is given to, by name."""
    roles = ["--input", "u:V", "--output", f"y:{unit}"]
    return {
        "inspect": [
            "inspect",
            str(file),
            "--report",
            str(folder / "i.html"),
            "--write-mapping",
            str(folder / "m.toml"),
            "--overwrite",
        ],
        "identify": ["identify", str(file), *roles, "--report", str(folder / "r.html"), "--overwrite"],
        "identify --json": ["identify", str(file), *roles, "--json"],
        "identify --sample-time": ["identify", str(file), *roles, "--sample-time", "1e-300"],
        "why": ["why", str(file), *roles, "--claimed", "tau=0.13"],
        "convert": ["convert", str(file), str(folder / "c.csv"), "--overwrite"],
        "tune": ["tune", str(file), *roles],
        "stability": ["stability", str(file), *roles, "--kp", "5"],
    }


def outcome(words: list[str]) -> str:
    """Return what is wrong with how a command ends; empty where it is a result, or one sentence with the right status."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = main(words)
        except BaseException as error:
            return f"raises {error!r}"
    said = [line for line in err.getvalue().splitlines() if line and "so far" not in line]
    if status not in OUTCOMES:
        return f"status {status}: {' '.join(said)[-3000:]}"
    if any("Warning" in line or "Traceback" in line for line in said):
        return f"says {said}"
    return ""


def _cases(seeds: range, folder: Path) -> Iterator[tuple[int, str, list[str]]]:
    for seed in seeds:
        hurt = recording(seed)
        file = folder / f"a{ENDINGS[seed % len(ENDINGS)]}"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            save(hurt, file)
        lines = commands(file, folder, str(hurt["y"].channel.unit))
        names = list(lines)
        for name in (names[seed % len(names)], names[(seed // len(names)) % len(names)]):
            yield seed, name, lines[name]


def _hurt_result(document: dict[str, object], random: np.random.Generator) -> dict[str, object]:
    """A result in which one to five numbers are others, or no numbers at all."""
    hurt = json.loads(json.dumps(document))
    places = [
        place
        for part in ("parameters", "covariance", "transfer_function", "operating_range", "records")
        for place in _numbers_in(hurt, part)
    ]
    for k in random.choice(len(places), int(random.choice([1, 1, 2, 5])), replace=False):
        inside, key = places[int(k)]
        inside[key] = random.choice(np.array([*_SIZES, 0.0, -1.0, None, "x"], dtype=object))
    return dict(hurt)


def _numbers_in(inside: Any, key: Any) -> Iterator[tuple[Any, Any]]:
    """The places of the numbers in a part of a document."""
    found = inside[key]
    if isinstance(found, dict | list):
        for inner in found if isinstance(found, dict) else range(len(found)):
            yield from _numbers_in(found, inner)
    elif isinstance(found, int | float) and not isinstance(found, bool):
        yield inside, key


def cases_of_results(seeds: range, folder: Path) -> Iterator[tuple[int, str, list[str]]]:
    """Yield seeds and command lines, by name, for results of which some numbers are others."""
    logger = Path(__file__).parents[2] / "examples" / "logger.csv"
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()):
        main(["identify", str(logger), "--output", "angle:deg", "--json"])
    sound = json.loads(out.getvalue())
    file = folder / "result.json"
    for seed in seeds:
        file.write_text(json.dumps(_hurt_result(sound, np.random.default_rng(seed))))
        lines = {
            "tune": ["tune", str(file), "--damping", "0.8", "--bandwidth", "20"],
            "stability": ["stability", str(file), "--kp", "5"],
            "export": ["export", str(file), "--as", "c", "--out", str(folder / "c.c"), "--overwrite"],
        }
        if seed % 10 == 0:  # it takes seconds
            lines["design"] = [
                "design",
                "--from",
                str(file),
                "--counts-per-rev",
                "2048",
                "--voltage-limit",
                "9",
                "--duration",
                "2",
            ]
        for name, words in lines.items():
            yield seed, name, words


def run(first: int, count: int, folder: Path, seconds: float) -> dict[str, object]:
    """Return what went wrong with so many seeds, or as many as can be done in so many seconds of CPU time."""
    warnings.simplefilter("error")
    begin, done, wrong = time.process_time(), 0, []
    seeds = range(first, first + count)
    for seed, name, words in chain(cases_of_results(seeds[:40], folder), _cases(seeds, folder)):
        if time.process_time() - begin > seconds:
            break
        before = time.process_time()
        found = outcome(words)
        if found:
            wrong.append(f"seed {seed}, {name}: {found}")
        if time.process_time() - before > 20:
            wrong.append(f"seed {seed}, {name}: {time.process_time() - before:.0f} s of CPU time")
        done += 1
    return {"done": done, "wrong": wrong}


if __name__ == "__main__":
    print(json.dumps(run(int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]), float(sys.argv[4]))))
