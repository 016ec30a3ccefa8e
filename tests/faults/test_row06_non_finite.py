"""Row 6: NaN, infinities and what is no number at all. None of it reaches a back-end, from wherever it comes."""

import json
import math
import random
import struct
from collections.abc import Callable, Iterator
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from servobench.channels import Sample
from servobench.devices.base import RunEnded
from servobench.devices.guarded import Guarded
from servobench.errors import UsageError
from servobench.experiment import Limits, read_experiment
from servobench.loop.run import run
from tests.loop.shaft import Controller, Shaft, odd

LIMIT = 10.0
API_CASES, JSON_CASES, CONTROLLER_CASES, TOML_CASES = 60_000, 38_500, 1_000, 500


class BackEnd(Shaft):
    """A shaft that notes what reaches it, as it was given."""

    def __init__(self) -> None:
        super().__init__()
        self.reached: list[Any] = []

    def write(self, voltage: float) -> float:
        self.reached.append(voltage)
        return super().write(voltage)


def payload(source: random.Random) -> float:
    """Return a NaN with any sign and payload, or an infinity: all the doubles that are no numbers."""
    bits = source.getrandbits(1) << 63 | 0x7FF << 52 | source.getrandbits(52) * source.getrandbits(1)
    return float(struct.unpack("<d", struct.pack("<Q", bits))[0])


NO_NUMBERS: tuple[Callable[[random.Random], Any], ...] = (
    payload,
    lambda source: np.float64(payload(source)),
    lambda source: np.float32(payload(source)),
    lambda source: np.float16(source.choice([math.nan, math.inf, -math.inf])),
    lambda source: source.choice([10**400, -(10**400)]),
    lambda source: source.choice(["nan", "inf", "-Infinity", "1e999", "5", "", "5 V"]),
    lambda source: source.choice([None, True, False, b"5", 1j, complex(math.nan, 1)]),
    lambda source: source.choice([Decimal("NaN"), Decimal("sNaN"), Decimal(5), Fraction(5)]),
    lambda source: source.choice(
        [[5.0], (5.0,), {}, {5.0}, np.array([5.0]), np.array(math.nan), object(), float]
    ),
    lambda source: math.inf - math.inf,
    lambda source: np.bool_(source.choice([True, False])),
)
NUMBERS: tuple[Callable[[random.Random], Any], ...] = (
    lambda source: source.uniform(-20, 20),
    lambda source: source.uniform(-1, 1) * 10 ** source.uniform(-300, 300),
    lambda source: source.randint(-(10**30), 10**30),
    lambda source: np.float32(source.uniform(-20, 20)),
    lambda source: np.int64(source.randint(-20, 20)),
    lambda source: source.choice([0.0, -0.0, 5e-324, 1.7976931348623157e308, -1.7976931348623157e308, LIMIT]),
)


def check_what_reached(back_end: BackEnd) -> None:
    """Hold that only voltages within the limit did, so that a clamp in a driver gives the same in either order."""
    for voltage in back_end.reached:
        assert type(voltage) is float
        assert math.isfinite(voltage)
        assert max(-LIMIT, min(LIMIT, voltage)) == min(max(voltage, -LIMIT), LIMIT) == voltage


def write_all(values: Iterator[tuple[bool, Any]]) -> int:
    """Write values, each with whether it is a number, on hold and acknowledged; return how many were none."""
    back_end, bad = BackEnd(), 0
    guarded = Guarded(back_end, when_faulted="hold")
    guarded.start(0.01, 0)
    for number, value in values:
        guarded.read()
        before = len(back_end.reached)
        applied = guarded.write(value)
        if number:
            assert guarded.fault is None
            assert abs(applied) <= 5.0  # the shaft's own limit
        else:
            bad += 1
            assert guarded.fault is not None
            assert guarded.fault.code == "voltage-not-finite"
            assert applied == 0.0
            assert set(back_end.reached[before:]) == {0.0}  # in the same sample
            assert back_end.voltage == 0.0
            guarded.acknowledge()
    check_what_reached(back_end)
    return bad


@pytest.mark.promise("S1", "S2")
def test_nothing_but_voltages_passes_the_interface() -> None:
    source = random.Random(6)

    def values() -> Iterator[tuple[bool, Any]]:
        for _ in range(API_CASES):
            number = source.random() < 0.1
            yield number, source.choice(NUMBERS if number else NO_NUMBERS)(source)

    assert write_all(values()) > 0.85 * API_CASES


@pytest.mark.promise("S1")
def test_nothing_but_voltages_passes_out_of_json() -> None:
    # Python's reader takes NaN, Infinity, and 1e999 as an infinity, without a word.
    source = random.Random(66)
    texts = (
        "NaN",
        "Infinity",
        "-Infinity",
        "1e999",
        "-1e999",
        '"5"',
        '"NaN"',
        "null",
        "true",
        "[5]",
        "{}",
        "9" * 400,
    )
    bad = write_all(
        (False, json.loads(f'{{"voltage": {source.choice(texts)}}}')["voltage"]) for _ in range(JSON_CASES)
    )

    assert bad == JSON_CASES


@pytest.mark.promise("S1")
def test_nothing_but_voltages_passes_out_of_a_controller() -> None:
    source = random.Random(666)
    for _ in range(CONTROLLER_CASES):
        value, at = source.choice(NO_NUMBERS)(source), source.randrange(1, 6)
        back_end = BackEnd()

        recording = run(
            odd(controller=Controller(lambda k, value=value, at=at: value if k == at else 2.0)),
            back_end,
        )

        assert recording.stopped.reason == "fault"
        assert "which is no voltage" in recording.stopped.sentence
        assert recording["applied"].values.tolist() == [2.0] * at + [0.0]
        assert back_end.reached[:at] == [2.0] * at
        assert set(back_end.reached[at:]) == {0.0}
        check_what_reached(back_end)


@pytest.mark.promise("S1")
def test_an_experiment_file_with_such_a_value_is_refused_before_there_is_a_device() -> None:
    source = random.Random(6666)
    places = (
        "[signal]\ntype = 'constant'\nvalue = {}",
        "[signal]\ntype = 'square'\nlow = 1\nhigh = {}",
        "[signal]\ntype = 'constant'\nvalue = 1\n[limits]\nvoltage = {}",
        "[signal]\ntype = 'constant'\nvalue = 1\n[limits.terminate]\nvoltage = {}",
    )
    values = ("nan", "-nan", "inf", "+inf", "-inf", "1e999", "'nan V'", "'1e999 V'", "true", "[1]", "{a = 1}")
    for _ in range(TOML_CASES):
        with pytest.raises(UsageError):
            read_experiment(source.choice(places).format(source.choice(values)))


@pytest.mark.promise("S1")
def test_there_are_100_000_cases_in_all() -> None:
    assert API_CASES + JSON_CASES + CONTROLLER_CASES + TOML_CASES >= 100_000


@pytest.mark.promise("S11")
def test_the_run_ends_with_the_value_in_its_reason_and_may_not_go_on_without_a_word() -> None:
    back_end = BackEnd()
    guarded = Guarded(back_end, Limits())
    guarded.start(0.01, 0)
    guarded.read()
    with pytest.raises(RunEnded, match="nan is no voltage; expected a finite number in V") as ended:
        guarded.write(math.nan)

    assert ended.value.stopped.reason == "fault"
    assert back_end.reached == [0.0]
    for again in (guarded.read, lambda: guarded.write(2.0)):
        with pytest.raises(RunEnded):
            again()
    with pytest.raises(UsageError, match=r"a fault is latched: .* nan is no voltage.*acknowledge"):
        guarded.start(0.01, 0)
    check_what_reached(back_end)
    guarded.acknowledge()
    guarded.start(0.01, 0)
    guarded.read()
    assert guarded.write(2.0) == 2.0


@pytest.mark.promise("S1")
def test_a_device_that_answers_with_no_number_is_stopped() -> None:
    class Odd(BackEnd):
        def write(self, voltage: float) -> float:
            return math.nan if super().write(voltage) else 0.0

        def read(self) -> Sample:
            return super().read()

    back_end = Odd()
    guarded = Guarded(back_end)
    guarded.start(0.01, 0)
    guarded.read()
    with pytest.raises(RunEnded, match="says that it puts out nan V"):
        guarded.write(2.0)
    assert back_end.reached == [2.0, 0.0]
