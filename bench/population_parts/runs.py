"""One random motor: what is true of it, how well that can be known, what is said of it, and what that cost."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

import numpy as np

from population_parts.bound import bound, cautious, turns_both_ways
from population_parts.departures import NONE, Departure
from population_parts.inputs import Array
from population_parts.motors import Case, drawn
from population_parts.simulator import Motion, moved, read, rows
from population_parts.statements import said
from servobench.core.channels import Channel
from servobench.core.errors import ServobenchError
from servobench.identification.identify import identify
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.measure import measure
from servobench.recordings.recording import Recording, Series, Source

SEED = 16
LIMIT = 60.0
"""Processor time after which a record is given up [s]."""

_ALL_THE_TIME = 0.5
"""Of the rows: an input that changes in more of them changes all the time."""
_UNITS = {"counts": "counts", "rad": "rad", "differentiated": "rad/s", "speed": "rad/s"}

Row = dict[str, Any]


class TooLong(BaseException):
    """A record took more than the limit; nothing that catches errors catches this one."""


def outcome(number: int, departure: Departure = NONE) -> Row:
    """Return what came of the motor of that number, as plain data."""
    seed = (SEED, number) if departure is NONE else (SEED, number, _name_as_number(departure.name))
    case = drawn(seed, departure)
    motion = moved(case)
    row = _described(case, motion, number)
    recording = recorded(case, read(case, motion))
    began = time.process_time()
    try:
        with _limited(LIMIT):
            row |= said(identify(measure(recording)))
    except TooLong:
        row |= {"verdict": "over time"}
    except ServobenchError as error:
        row |= {"verdict": "refused", "error": str(error)}
    except Exception as error:  # a crash is a finding of this bench, not its end
        row |= {"verdict": "crashed", "error": f"{type(error).__name__}: {error}"}
    row["seconds"] = round(time.process_time() - began, 4)
    if "estimates" in row:
        row["true"] |= together(row["true"], row["level"])
    if (
        row.get("structure") == "first_order_one_way_rest"
    ):  # its friction brakes whichever way the shaft turns: it has no sign
        least, most = sorted(map(abs, row["true"]["coulomb_voltage"]))
        row["true"]["coulomb_voltage"] = (least, most)
    return row


def recorded(case: Case, values: Array) -> Recording:
    """Return the record as its owner would hand it in: input and output with their units, and what is known of the chain."""
    t, u = rows(case)
    unit = _UNITS[case.output]
    turn = float(case.motor.counts) if unit == "counts" else None
    series = (
        Series(channel=Channel(name="voltage", unit="V"), values=u, t=t),
        Series(channel=Channel(name="output", unit=unit, counts_per_rev=turn), values=values, t=t),
    )
    name = "random motor"
    return Recording(
        name=name, series=series, source=Source(name=name), input="voltage", output="output", chain=case.chain
    )


def dataset(number: int) -> Dataset:
    """Return the record of the motor of that number, as identification takes it."""
    case = drawn((SEED, number))
    return measure(recorded(case, read(case, moved(case))))


def warmed_up() -> None:
    """Compile what is compiled at its first use, so that no record's processor time has it in it."""
    for number in range(6):
        outcome(number)


def true(case: Case, motion: Motion) -> dict[str, tuple[float, float]]:
    """Return what is true of each parameter, from lowest to highest."""
    motor = case.motor
    values = motor.departure.true(motor.tau, motor.delay, motor.coulomb)
    sizes = np.unique(np.abs(rows(case)[1]))
    one_size = len(sizes[sizes > 0.0]) == 1
    both = turns_both_ways(case, motion)
    if not both and float(np.mean(motion.speed)) < 0.0:
        # What is stated of a motor that turns one way is the input that is lost, with its sign.
        least, most = values["coulomb_voltage"]
        values = {**values, "coulomb_voltage": (-most, -least)}
    return {
        "gain": motor.departure.gains(motor.gain, motor.coulomb, one_size),
        **values,
        "offset_voltage": (0.0, 0.0) if both else values["coulomb_voltage"],
    }


def together(values: dict[str, tuple[float, float]], level: float) -> dict[str, tuple[float, float]]:
    """Return what is true of combinations of those values, from lowest to highest: K/τ, and the speed at a voltage [V]."""
    (slowest, fastest), (short, long), (least, most) = (
        values[name] for name in ("gain", "time_constant", "coulomb_voltage")
    )
    left = [max(abs(level) - lost, 0.0) for lost in sorted((abs(least), abs(most)), reverse=True)]
    speeds = sorted(
        math.copysign(1.0, level) * gain * volt for gain, volt in zip((slowest, fastest), left, strict=True)
    )
    return {"acceleration": (slowest / long, fastest / short), "speed_at_level": (speeds[0], speeds[1])}


def outcomes(
    numbers: range, departure: Departure = NONE, show: Callable[[Row], None] = lambda row: None
) -> list[Row]:
    """Return what came of each motor; `show` sees each as soon as it is there."""
    found = []
    for number in numbers:
        found.append(outcome(number, departure))
        show(found[-1])
    return found


def _described(case: Case, motion: Motion, number: int) -> Row:
    motor = case.motor
    return {
        "number": number,
        "departure": motor.departure.name,
        "input": case.input,
        "events": events(rows(case)[1], motion.before),
        "output": case.output,
        "chain": case.chain,
        "start": case.start,
        "rows": len(motion.speed),
        "both_ways": turns_both_ways(case, motion),
        "tau_over_sample": motor.tau / motor.sample_time,
        "sample_time": motor.sample_time,
        "delay_samples": motor.delay / motor.sample_time,
        "amplitude": case.amplitude,
        "coulomb_share": motor.coulomb / case.amplitude,
        "counts": motor.counts,
        "noise": motor.noise / (1.0 if case.output == "speed" else motor.quantum),
        "wander": math.sqrt(motor.torque / (2 * motor.tau)) / case.amplitude,
        "travel": float(np.ptp(motion.angle)) / motor.quantum,
        "true": true(case, motion),
        "bound": bound(case, motion),
        "cautious": cautious(case, motion),
    }


def events(u: Array, before: float) -> int:
    """Return how many events an input (N,) has: its jumps, or its turning points where it changes all the time."""
    change = np.diff(u, prepend=before)
    jumps = change[change != 0.0]
    if len(jumps) < _ALL_THE_TIME * len(u):
        return len(jumps)
    return 1 + int(np.count_nonzero(np.diff(np.sign(jumps))))


def _name_as_number(name: str) -> int:
    """A number that stands for a name, the same in each run."""
    return int.from_bytes(name.encode()[:7], "big")


@contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Raise `TooLong` once that much processor time is used up within."""

    def end(number: int, frame: FrameType | None) -> None:
        raise TooLong

    before = signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
