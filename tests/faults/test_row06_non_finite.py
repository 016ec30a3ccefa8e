"""Row 6: NaN, infinities and what is no number at all. None of it reaches a back-end, from wherever it comes."""

import json
import math
import random
import struct
from collections.abc import Callable, Iterator
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from servobench.core.channels import Channel, DeviceInfo, Sample
from servobench.core.errors import DeviceError, UsageError
from servobench.rig.devices.base import RunEnded
from servobench.rig.devices.guarded import Guarded
from servobench.rig.devices.observed import Call, Observed
from servobench.rig.experiment import Limits, read_experiment
from servobench.rig.loop.run import run
from servobench.rig.lost_device import DeviceLost
from tests.rig.loop.shaft import Controller, Shaft, odd

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


class Answering(BackEnd):
    """A device of ±10 V, or of no stated range, whose every write answers the same."""

    def __init__(self, answer: Any, *, ranged: bool = True) -> None:
        super().__init__()
        self.answer = answer
        self._bound = 10.0 if ranged else None

    @property
    def info(self) -> DeviceInfo:
        below = None if self._bound is None else -self._bound
        voltage = Channel(name="voltage", unit="V", minimum=below, maximum=self._bound)
        rest = tuple(each for each in super().info.channels if each.name != "voltage")
        return replace(super().info, channels=(voltage, *rest))

    def write(self, voltage: float) -> Any:
        super().write(voltage)
        return self.answer


class Nobody:
    """An observer whom nothing interests."""

    def began(self, call: Call) -> None:
        pass

    def note_return(self, call: Call) -> None:
        pass

    def output(self, is_zero: bool) -> None:
        pass


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
        assert "which isn't a voltage" in recording.stopped.sentence
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
    with pytest.raises(RunEnded, match="nan isn't a voltage; expected a finite number in V") as ended:
        guarded.write(math.nan)

    assert ended.value.stopped.reason == "fault"
    assert back_end.reached == [0.0]
    for again in (guarded.read, lambda: guarded.write(2.0)):
        with pytest.raises(RunEnded):
            again()
    with pytest.raises(UsageError, match=r"a fault is latched: .* nan isn't a voltage.*acknowledge"):
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
    with pytest.raises(
        RunEnded, match=r"write\(\) of the device .* returned nan; expected a finite number in V"
    ):
        guarded.write(2.0)
    assert back_end.reached == [2.0, 0.0]


@pytest.mark.promise("S1")
@pytest.mark.parametrize(
    ("answer", "shown"),
    [
        (None, "returned None; expected a finite number in V"),
        ("3.0", "returned '3.0' (of type str); expected a finite number in V"),
        (True, "returned True (of type bool); expected a finite number in V"),
        (1 + 2j, "returned (1+2j) (of type complex); expected a finite number in V"),
        ([3.0], "returned [3.0] (of type list); expected a finite number in V"),
        (np.array([3.0]), "returned array([3.]) (of type numpy.ndarray); expected a finite number in V"),
        pytest.param(
            10**400, f"returned 1{36 * '0'}... (of type int); expected a finite number in V", id="huge"
        ),
        (-math.inf, "returned -inf; expected a finite number in V"),
        (2**70, f"returned {2**70} (of type int), beyond its range of -10 to 10 V"),
        (1e300, "returned 1e+300, beyond its range of -10 to 10 V"),
        (-25.0, "returned -25.0, beyond its range of -10 to 10 V"),
        (np.float32(10.25), "returned 10.25, beyond its range of -10 to 10 V"),
    ],
)
@pytest.mark.parametrize("observed", [False, True])
def test_an_answer_to_a_write_that_can_not_be_the_voltage_stops_the_motor(
    answer: Any, shown: str, observed: bool
) -> None:
    back_end = Answering(answer)
    guarded = Guarded(Observed(back_end, Nobody()) if observed else back_end)
    guarded.start(0.01, 0)
    guarded.read()
    with pytest.raises(RunEnded) as ended:
        guarded.write(2.0)
    assert ended.value.stopped.reason == "fault"
    assert f"write() of the device '{back_end.info.name}' {shown}" in ended.value.stopped.sentence
    assert back_end.reached == [2.0, 0.0]
    guarded.stop()  # zero volts were answered as oddly, which must not keep the device from being stopped
    assert back_end.events[-1] == "stop"


@pytest.mark.parametrize("answer", [2, np.float32(2.0), np.float64(2.0), 10.0, -10.019])
def test_an_answer_that_is_a_number_within_the_range_or_its_rounding_is_none(answer: Any) -> None:
    # 0.1 % of the range of 20 V is 0.02 V.
    guarded = Guarded(Answering(answer))
    guarded.start(0.01, 0)
    guarded.read()
    applied = guarded.write(2.0)
    assert type(applied) is float
    assert applied == float(answer)
    assert guarded.fault is None


@pytest.mark.parametrize(("answer", "fault"), [(25.0, False), (999_999.0, False), (1.1e6, True)])
def test_without_a_range_of_its_own_a_device_may_answer_up_to_a_million_volts(
    answer: float, fault: bool
) -> None:
    device = Answering(answer, ranged=False)
    guarded = Guarded(device, when_faulted="hold")
    guarded.start(0.01, 0)
    guarded.read()
    if fault:
        with pytest.raises(DeviceError, match="-1e\\+06 to 1e\\+06 V"):  # zero volts are answered so, too
            guarded.write(2.0)
    else:
        assert guarded.write(2.0) == answer
    assert (guarded.fault is not None) == fault


NOT_COUNTED = (
    (math.nan, "nan", math.nan),
    (math.inf, "inf", math.inf),
    (-math.inf, "-inf", -math.inf),
    (np.float64(math.nan), "nan", math.nan),
    (None, "None", math.nan),
    ("12", "'12' (of type str)", math.nan),
    ([1, 2], "[1, 2] (of type list)", math.nan),
    (np.array([3]), "array([3]) (of type numpy.ndarray)", math.nan),
    (True, "True (of type bool)", math.nan),
    (10**400, "(of type int)", math.nan),
    (2**63, f"{2**63} (of type int)", float(2**63)),
)


class Measured(BackEnd):
    """A shaft of which one sample has another value in a field."""

    def __init__(self, field: str, value: Any, at: int = 5) -> None:
        super().__init__()
        self.tachometer = field == "tachometer"
        self.field, self.value, self.at = field, value, at

    def read(self) -> Sample:
        sample = super().read()
        return replace(sample, **{self.field: self.value}) if sample.index == self.at else sample


@pytest.mark.promise("S50")
@pytest.mark.parametrize(("counts", "shown", "recorded"), NOT_COUNTED, ids=range(len(NOT_COUNTED)))
def test_counts_that_are_no_number_stop_the_motor_in_the_same_sample_and_are_recorded(
    counts: Any, shown: str, recorded: float
) -> None:
    back_end = Measured("counts", counts)
    seen: list[Any] = []

    class Watching(Controller):
        def step(self, state: int, reference: float, sample: Sample) -> tuple[int, Any]:
            seen.append(sample.counts)
            return super().step(state, reference, sample)

    recording = run(odd(controller=Watching(lambda k: 2.0)), back_end)

    assert recording.stopped.reason == "fault"
    assert recording.stopped.sentence.startswith("the motor was stopped at 0.05 s: the device gave ")
    assert f"{shown} as its counts" in recording.stopped.sentence
    assert "Check its encoder, the cable, and the driver that reads it" in recording.stopped.sentence
    assert recording["applied"].values.tolist() == [2.0] * 5 + [0.0]
    assert np.array_equal(recording["counts"].values, [0, 2, 4, 6, 8, recorded], equal_nan=True)
    assert back_end.reached[:5] == [2.0] * 5
    assert set(back_end.reached[5:]) == {0.0}
    assert back_end.voltage == 0.0
    assert len(seen) == 5  # no controller ever sees it


@pytest.mark.promise("S50")
@pytest.mark.parametrize("field", ["counts", "tachometer", "current", "time"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, "1", np.array([1.0])])
def test_no_value_of_a_sample_may_be_anything_but_a_finite_number_with_or_without_limits(
    field: str, value: Any
) -> None:
    for limits in (Limits(), Limits(stall=None, plausibility=None)):
        back_end = Measured(field, value)
        guarded = Guarded(back_end, limits)
        guarded.start(0.01, 0)
        for _ in range(5):
            guarded.read()
            guarded.write(2.0)
        with pytest.raises(RunEnded, match=f"as its {field}; expected a finite number"):
            guarded.read()
        assert guarded.fault is not None
        assert guarded.fault.code == "sample-not-finite"
        assert back_end.reached == [2.0] * 5 + [0.0]


@pytest.mark.promise("S50")
def test_a_sample_without_a_tachometer_or_a_current_is_no_fault() -> None:
    recording = run(odd(controller=Controller(lambda k: 2.0)), Measured("current", None))

    assert recording.stopped.reason == "finished"


@pytest.mark.promise("S50")
def test_on_hold_the_run_goes_on_at_zero_volts_and_the_controller_after_the_acknowledgement() -> None:
    back_end = Measured("counts", math.nan)
    guarded = Guarded(back_end, when_faulted="hold")
    guarded.start(0.01, 0)
    counts = []
    for _ in range(8):
        counts.append(guarded.read().counts)
        guarded.write(2.0)
    assert math.isnan(counts[5])
    assert back_end.reached[:5] == [2.0] * 5
    assert set(back_end.reached[5:]) == {0.0}
    assert guarded.unwrapped == counts[-1]  # the position isn't lost

    guarded.acknowledge()
    guarded.read()
    assert guarded.write(2.0) == 2.0


def test_a_read_that_returns_no_sample_is_a_device_that_failed() -> None:
    class Mute(BackEnd):
        def read(self) -> Any:
            return None

    back_end = Mute()
    with pytest.raises(DeviceLost, match=r"shaft: its read\(\) returned None; expected a Sample") as lost:
        run(odd(controller=Controller(lambda k: 2.0)), back_end)
    assert lost.value.recording.stopped.reason == "device_lost"
    assert back_end.voltage == 0.0


class Unprintable:
    def __repr__(self) -> str:
        raise RuntimeError


@pytest.mark.parametrize(
    ("returned", "shown"),
    [
        ("3.0", "'3.0' (of type str)"),
        (None, "None"),
        (np.array([3.0]), "array([3.]) (of type numpy.ndarray)"),
        (np.zeros((9, 9)), "(of type numpy.ndarray)"),
        (True, "True (of type bool)"),
        (math.nan, "nan"),
        (10**5000, "a value (of type int)"),
        (Unprintable(), "a value (of type tests.faults.test_row06_non_finite.Unpri)"),
    ],
    ids=range(8),
)
def test_a_controller_is_told_what_it_returned_of_which_type_and_what_was_expected(
    returned: Any, shown: str
) -> None:
    recording = run(odd(controller=Controller(lambda k: returned if k == 3 else 2.0)), BackEnd())

    reason = recording.stopped.sentence
    assert recording.stopped.reason == "fault"
    assert "the controller returned " in reason
    assert f"{shown}, which isn't a voltage; expected a finite number in V" in reason
    assert "\n" not in reason
    assert len(reason) < 200
    assert recording["applied"].values.tolist() == [2.0] * 3 + [0.0]


@pytest.mark.parametrize(
    ("returned", "shown"), [(3.0, "3.0"), (None, "None"), ((0, 1.0, 2.0), "(0, 1.0, 2.0) (of type tuple)")]
)
def test_a_step_that_returns_no_pair_is_told_so(returned: Any, shown: str) -> None:
    class Alone(Controller):
        def step(self, state: int, reference: float, sample: Sample) -> Any:
            return returned

    back_end = BackEnd()
    recording = run(odd(controller=Alone(lambda k: 0.0)), back_end)

    assert recording.stopped.reason == "fault"
    assert f"the controller returned {shown}, which isn't a voltage; expected the pair (state, voltage)" in (
        recording.stopped.sentence
    )
    assert back_end.voltage == 0.0
