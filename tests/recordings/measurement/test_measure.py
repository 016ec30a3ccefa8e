"""The verb `measure`: units, counts, chains, and what it tells of data that look wrong."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import accumulate

import numpy as np
import pytest

from servobench.core.channels import Channel, DeviceInfo
from servobench.core.errors import MissingInformation, NotIdentifiable, UsageError
from servobench.core.finding import Severity, warning
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.measure import measure
from servobench.recordings.recording import Recording, Series, Source

QUANTUM = 2.0 * np.pi / 2048
T = 0.002 * np.arange(2000)
TRAVEL = 40.0 * T - 4.0 * (1.0 - np.exp(-T / 0.1))  # rad: a first-order start to 40 rad/s


def recording(
    values: np.ndarray,
    unit: str | None,
    *,
    t: np.ndarray | None = T,
    u: np.ndarray | None = None,
    input_unit: str | None = "V",
    chain: str = "",
    counter_bits: int | None = None,
    counts_per_rev: float | None = None,
    resolution: float | None = None,
) -> Recording:
    output = Channel(
        name="theta",
        unit=unit,
        counter_bits=counter_bits,
        counts_per_rev=counts_per_rev,
        resolution=resolution,
    )
    drive = np.full(len(values), 2.0) if u is None else u
    return Recording(
        name="test.csv",
        series=(
            Series(channel=Channel(name="u", unit=input_unit), values=drive, t=t),
            Series(channel=output, values=np.asarray(values, dtype=float), t=t),
        ),
        source=Source(name="test.csv", sha256="ab", format="csv"),
        input="u",
        output="theta",
        chain=chain,
    )


def counts_of(travel: np.ndarray) -> np.ndarray:
    return np.floor(travel / QUANTUM)


def codes(data: Dataset) -> Mapping[str, Severity]:
    return {finding.code: finding.severity for finding in data.findings}


@pytest.mark.parametrize(
    ("unit", "factor", "si", "kind"),
    [
        ("rad", 1.0, "rad", "position"),
        ("deg", np.pi / 180, "rad", "position"),
        ("rev", 2 * np.pi, "rad", "position"),
        ("mm", 1e-3, "m", "position"),
        ("rpm", 2 * np.pi / 60, "rad/s", "speed"),
        ("deg/s", np.pi / 180, "rad/s", "speed"),
        ("counts/s", 1.0, "counts/s", "speed"),
        ("m/s", 1.0, "m/s", "speed"),
    ],
)
def test_the_output_comes_in_si_units(unit: str, factor: float, si: str, kind: str) -> None:
    data = measure(recording(TRAVEL, unit))

    np.testing.assert_allclose(data.y, factor * TRAVEL, rtol=1e-15)
    assert (data.output_unit, data.kind, data.position_unit) == (si, kind, si.removesuffix("/s"))
    np.testing.assert_array_equal(data.t_output, T)
    assert data.findings == ()


@pytest.mark.parametrize(
    ("unit", "factor", "si"),
    [
        ("V", 1.0, "V"),
        ("mV", 1e-3, "V"),
        ("mA", 1e-3, "A"),
        ("%", 1.0, "%"),
        ("N", 1.0, "N"),
        ("1", 1.0, "1"),
    ],
)
def test_the_input_comes_in_si_units_and_keeps_a_unit_without_one(unit: str, factor: float, si: str) -> None:
    given = replace(recording(TRAVEL, "rad", u=np.arange(2000.0), input_unit=unit), input_before=7.0)

    data = measure(given)

    np.testing.assert_allclose(data.u, factor * np.arange(2000.0), rtol=1e-15)
    assert data.input_unit == si
    assert data.input_before == pytest.approx(factor * 7.0)


def test_an_input_before_the_record_that_nobody_knows_is_the_first_one() -> None:
    assert measure(recording(TRAVEL, "rad", u=np.linspace(3.0, 4.0, 2000))).input_before == 3.0


def test_what_the_recording_knows_is_carried_on() -> None:
    found = warning("odd-file", "The file is odd.")
    info = DeviceInfo(name="twin", delay=0.0007)

    data = measure(replace(recording(TRAVEL, "rad"), findings=(found,), info=info))

    assert data.findings == (found,)
    assert data.delay == 0.0007
    assert data.source.sha256 == "ab"
    assert data.name == "test.csv"


def test_input_and_output_keep_their_own_times() -> None:
    given = recording(TRAVEL, "rad")
    slow = Series(channel=given["u"].channel, values=np.ones(20), t=0.1 * np.arange(20.0) + 0.013)

    data = measure(replace(given, series=(slow, given["theta"])))

    assert data.t_input[0] == 0.013
    assert len(data.u) == 20
    assert len(data.y) == 2000


@pytest.mark.parametrize("bits", [16, 24, 32, None])
def test_counts_become_an_angle_whose_error_is_below_half_a_count(bits: int | None) -> None:
    start = 2.0 ** (bits - 1) - 100 if bits else 0.0
    shown = counts_of(TRAVEL) + start
    shown = np.where(shown >= 2.0 ** (bits - 1), shown - 2.0**bits, shown) if bits else shown

    data = measure(recording(shown, "counts", counter_bits=bits, counts_per_rev=2048))

    assert data.output_unit == "rad"
    assert data.quantum == pytest.approx(QUANTUM)
    error = data.y - start * QUANTUM - TRAVEL
    # The middle of a bin is at most half a bin off; the start of 2^31 counts is 6.6e6 rad, rounded to 1e-9.
    assert np.abs(error).max() <= 0.5 * QUANTUM + 1e-8
    assert abs(error.mean()) < 0.02 * QUANTUM
    assert data.findings == ()
    assert not data.chain


def test_counts_of_an_unknown_encoder_stay_counts() -> None:
    data = measure(recording(counts_of(TRAVEL), "ticks"))

    np.testing.assert_array_equal(data.y, counts_of(TRAVEL) + 0.5)
    assert (data.output_unit, data.position_unit, data.quantum) == ("counts", "counts", 1.0)


def test_counts_that_are_not_whole_are_not_moved_and_have_no_quantum() -> None:
    data = measure(recording(TRAVEL / QUANTUM, "counts", counts_per_rev=2048))

    np.testing.assert_allclose(data.y, TRAVEL, rtol=0, atol=1e-12)
    assert data.quantum is None


def test_a_speed_in_counts_becomes_one_in_radians() -> None:
    data = measure(recording(np.linspace(0, 2048, 2000), "counts/s", counts_per_rev=2048))

    assert data.output_unit == "rad/s"
    assert data.y[-1] == pytest.approx(2 * np.pi)
    assert data.quantum is None


def test_a_counter_that_moves_half_its_range_in_one_sample_is_reported_with_the_row() -> None:
    shown = np.array([0.0, 100.0, 200.0, -32568.0, -32468.0, -32368.0])

    data = measure(recording(shown, "counts", t=T[:6], counter_bits=16))

    assert codes(data) == {"unwrap-ambiguous": Severity.WARNING}
    assert data.findings[0].rows == (4, 5)
    assert "row 4" in data.findings[0].sentence


def test_a_counter_too_fast_for_its_width_is_reported() -> None:
    travel = np.cumsum(
        np.linspace(0.0, 50000.0, 200)
    ).round()  # up to three quarters of the modulus in a sample

    data = measure(recording((travel + 32768) % 65536 - 32768, "counts", t=T[:200], counter_bits=16))

    assert codes(data) == {"unwrap-ambiguous": Severity.WARNING}


def test_the_speed_up_to_which_a_counter_can_be_unwrapped_is_stated_where_it_is_near() -> None:
    """Steps of 3,000 of 65,536 counts in 2 ms are a twentieth; 32,768 in that time are 16.4 million counts a second."""
    travel = 3000.0 * np.arange(200)

    data = measure(recording((travel + 32768) % 65536 - 32768, "counts", t=T[:200], counter_bits=16))
    slow = measure(recording((travel / 5 + 32768) % 65536 - 32768, "counts", t=T[:200], counter_bits=16))

    assert codes(data) == {"unwrap-limit": Severity.INFO}
    assert f"{32768 / (T[1] - T[0]) / 1e6:.3g}" in data.findings[0].sentence
    assert codes(slow) == {}


def test_a_counter_of_more_than_its_width_is_reported() -> None:
    shown = np.concatenate([np.arange(0.0, 100000.0, 1000.0), np.arange(0.0, 100000.0, 1000.0)])

    data = measure(recording(shown, "counts", t=T[:200], counter_bits=16))

    assert "unwrap-out-of-range" in codes(data)


@pytest.mark.parametrize(("unit", "turn"), [("deg", 360.0), ("rad", 2 * np.pi), ("rev", 1.0)])
@pytest.mark.parametrize("low", [0.0, -0.5])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_angle_that_wraps_is_reported_and_not_repaired(
    unit: str, turn: float, low: float, sign: float
) -> None:
    wrapped = turn * ((sign * TRAVEL / (2 * np.pi) - low) % 1.0 + low)

    data = measure(recording(wrapped, unit))

    assert codes(data) == {"angle-wraps": Severity.REFUSAL}
    assert "unwrap 360 deg" in data.findings[0].sentence
    assert np.ptp(data.y) <= 2 * np.pi
    first = int(np.flatnonzero(np.abs(np.diff(wrapped)) > turn / 2)[0]) + 2
    assert data.findings[0].rows is not None
    assert data.findings[0].rows[0] == first

    repaired = measure(recording(wrapped, unit), "unwrap 360 deg")

    np.testing.assert_allclose(repaired.y - repaired.y[0], sign * TRAVEL, rtol=0, atol=1e-9)
    assert repaired.findings == ()
    assert repaired.kind == "position"


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_angle_that_wraps_at_a_turn_to_either_side_is_reported_with_false_values_in_the_wraps(
    sign: float,
) -> None:
    """It ends at a turn and begins at the other one; one value of each wrap is two turns off, as its parts were read apart."""
    degrees = np.degrees(TRAVEL * 8.0)
    wrapped = np.fmod(degrees, 720.0)
    wrapped = np.where(wrapped > 360.0, wrapped - 720.0, wrapped)
    at = np.flatnonzero(np.abs(np.diff(wrapped)) > 360.0)
    wrapped[at + 1] = wrapped[at] - np.sign(wrapped[at]) * 1080.0

    data = measure(recording(sign * wrapped, "deg"))

    assert len(at) > 2
    assert codes(data) == {"angle-wraps": Severity.REFUSAL}
    assert "unwrap 360 deg" in data.findings[0].sentence


def test_a_shaft_that_turns_by_more_than_half_a_turn_a_row_to_and_fro_does_not_wrap() -> None:
    """Faster one way than the other: without turns that aren't there it would go the other way all the time."""
    speed = np.tile(np.concatenate([np.full(60, 440.0), np.full(100, -262.0)]), 5)
    lag = np.exp(-0.01 / 0.05)
    turned = 0.01 * np.cumsum(list(accumulate(speed, lambda before, to: to + lag * (before - to))))

    assert "angle-wraps" not in codes(measure(recording(turned, "rad", t=0.01 * np.arange(len(speed)))))


def test_turns_that_are_lost_are_no_wraps() -> None:
    """A shaft that turns on and on, whose position lacks a turn from three rows on."""
    lost = np.cumsum(np.isin(np.arange(len(TRAVEL)), [1000, 2000, 3000]))

    assert "angle-wraps" not in codes(measure(recording(8.0 * TRAVEL - 2 * np.pi * lost, "rad")))


@pytest.mark.parametrize(
    ("modulus", "advice"),
    [(modulus, f"unwrap {modulus:.0f} counts") for modulus in (256.0, 1024.0, 2048.0, 4096.0, 65536.0)],
)
def test_counts_that_wrap_unasked_are_reported(modulus: float, advice: str) -> None:
    shown = (counts_of(TRAVEL) + 0.9 * modulus).round() % modulus

    data = measure(recording(shown, "counts", counts_per_rev=2048))

    assert codes(data) == {"angle-wraps": Severity.REFUSAL}
    assert advice in data.findings[0].sentence
    repaired = measure(recording(shown, "counts", counts_per_rev=2048), advice)
    np.testing.assert_allclose(repaired.y - repaired.y[0], TRAVEL, rtol=0, atol=1.01 * QUANTUM)
    assert repaired.quantum == pytest.approx(QUANTUM)
    assert set(codes(repaired)) <= {"unwrap-limit"}


def test_a_potentiometer_that_begins_anew_before_a_turn_is_over_is_reported() -> None:
    """The first part of a turn is between the ends of its track: it reads 0 to 340 degrees, whatever a degree is."""
    turning = 3.0 * np.arange(300.0)
    shown = (turning + 100.0) % 340.0

    data = measure(recording(shown, "deg", t=0.002 * np.arange(300)))

    assert codes(data) == {"angle-wraps": Severity.REFUSAL}
    assert "`unwrap 340 deg`" in data.findings[0].sentence
    repaired = measure(recording(shown, "deg", t=0.002 * np.arange(300)), "unwrap 340 deg")
    np.testing.assert_allclose(repaired.y - repaired.y[0], np.radians(turning), rtol=0, atol=1e-9)


FLICKER = np.resize([0.0, 6.0], 300)  # degrees
FLIPPED = np.searchsorted([21, 40, 61, 80, 100, 121, 140, 161, 180, 201], np.arange(300), side="right") % 2
"""Whether a servo is 350° further: after four of its ten leaps it goes on as after a wrap, after six of them it doesn't."""


@pytest.mark.parametrize(
    "travel",
    [
        np.array([0.0, 0.1, 1.0, 3.0, 5.5, 6.2, 6.2, 6.2]),  # a leap to a new place, coarsely sampled
        3.0 * np.sin(20.0 * T),
        np.zeros(50),
        10.0 * np.arange(100.0),  # more than a turn in every sample
        np.radians(FLICKER + 350 * FLIPPED),
        np.radians(
            np.resize([-109.5, -113.5, -117.5], 300)
        ),  # a joint that swings, three samples to a period
    ],
)
def test_an_angle_that_only_moves_far_is_not_taken_for_one_that_wraps(travel: np.ndarray) -> None:
    assert "angle-wraps" not in codes(measure(recording(travel, "rad", t=0.002 * np.arange(len(travel)))))


def test_an_unwrapping_in_another_unit_than_the_data_is_refused() -> None:
    with pytest.raises(UsageError, match=r"unwrap 360 deg.*in counts"):
        measure(recording(counts_of(TRAVEL), "counts"), "unwrap 360 deg")
    with pytest.raises(UsageError, match=r"unwrap 65536 counts.*in rad"):
        measure(recording(TRAVEL, "deg"), "unwrap 16 bit")


def test_known_counts_can_be_unwrapped_as_counts_or_as_an_angle() -> None:
    shown = counts_of(TRAVEL) % 2048
    given = recording(shown, "counts", counts_per_rev=2048)

    np.testing.assert_allclose(
        measure(given, "unwrap 2048 counts").y, measure(given, "unwrap 1 rev").y, atol=1e-9
    )


def test_the_quantum_is_what_the_channel_says() -> None:
    assert measure(recording(TRAVEL, "deg", resolution=0.5)).quantum == pytest.approx(np.radians(0.5))


def test_rounded_degrees_are_put_back_on_the_steps_of_their_sensor() -> None:
    """Two decimals leave 36,000 steps in a turn, where the encoder has 2,048."""
    counts = counts_of(TRAVEL)

    data = measure(recording(np.round(counts * (360 / 2048), 2), "deg"))

    assert data.quantum == pytest.approx(QUANTUM, rel=1e-15)
    np.testing.assert_allclose(data.y, counts * QUANTUM, rtol=4e-16)
    assert codes(data) == {"quantum-found": Severity.INFO}


@pytest.mark.parametrize("digits", [4, 6, 15])
def test_the_quantum_is_found_where_values_lie_on_a_grid(digits: int) -> None:
    printed = np.round(counts_of(TRAVEL) * (360 / 2048), digits)

    data = measure(recording(printed, "deg"))

    assert data.quantum == pytest.approx(QUANTUM, rel=1e-3)
    assert codes(data) == {"quantum-found": Severity.INFO}
    assert measure(recording(printed, "deg"), "unwrap 360 deg").quantum == data.quantum
    assert measure(recording(printed, "deg"), "derivative").quantum is None
    assert measure(recording(printed, "deg", chain="lowpass 8 Hz")).quantum is None


def test_a_filtered_position_has_no_quantum() -> None:
    assert measure(recording(counts_of(TRAVEL), "counts"), "lowpass 50 rad/s").quantum is None
    assert measure(recording(counts_of(TRAVEL), "counts", chain="lowpass 50 rad/s")).quantum is None
    assert measure(recording(counts_of(TRAVEL), "counts"), "derivative").quantum is None


def test_the_chain_is_applied_to_the_position_and_kept() -> None:
    data = measure(
        recording(counts_of(TRAVEL), "counts", counts_per_rev=2048), "derivative | lowpass 50 rad/s"
    )

    assert (data.kind, data.output_unit) == ("speed", "rad/s")
    assert str(data.chain) == str(data.applied) == "derivative | lowpass 50 rad/s"
    assert not data.declared
    np.testing.assert_allclose(data.y, data.chain(counts_of(TRAVEL) * QUANTUM, T), rtol=0, atol=1e-10)


def test_a_chain_may_be_given_as_one() -> None:
    given = recording(TRAVEL, "rad")

    np.testing.assert_array_equal(measure(given, Chain.parse("derivative")).y, measure(given, "derivative").y)


def test_a_declared_chain_is_not_applied_again() -> None:
    speed = np.gradient(TRAVEL, T)

    data = measure(recording(speed, "rad/s", chain="derivative | lowpass 50 rad/s"), "average 20 ms")

    assert str(data.declared) == "derivative | lowpass 50 rad/s"
    assert str(data.applied) == "average 0.02 s"
    assert str(data.chain) == "derivative | lowpass 50 rad/s | average 0.02 s"
    assert data.shaft_kind == "position"
    np.testing.assert_array_equal(data.y, data.applied(speed, T))


@pytest.mark.parametrize("chain", ["derivative", "tachometer 10 ms", "unwrap 1 rev"])
def test_a_speed_is_not_differentiated(chain: str) -> None:
    with pytest.raises(UsageError, match=r"test.csv: the output 'theta' is a speed \(deg/s\)") as caught:
        measure(recording(TRAVEL, "deg/s"), chain)
    assert "recording's own chain" in str(caught.value)


@pytest.mark.parametrize(
    ("unit", "chain"),
    [("rad", "derivative"), ("deg", "tachometer 10 ms | lowpass 8 Hz"), ("rad/s", "unwrap 16 bit")],
)
def test_an_output_that_contradicts_its_declared_chain_is_refused(unit: str, chain: str) -> None:
    with pytest.raises(UsageError, match="one of the two is wrong"):
        measure(recording(TRAVEL, unit, chain=chain))


def test_a_scale_with_a_unit_turns_counts_into_an_angle_and_is_no_part_of_the_prediction() -> None:
    data = measure(recording(counts_of(TRAVEL), "counts"), "scale 0.17578125 deg/count")

    assert (data.output_unit, data.kind) == ("rad", "position")
    np.testing.assert_allclose(data.y, (counts_of(TRAVEL) + 0.5) * QUANTUM, rtol=1e-14)
    assert data.quantum == pytest.approx(QUANTUM)
    assert not data.chain


def test_a_scale_with_a_unit_may_stand_anywhere() -> None:
    given = recording(counts_of(TRAVEL), "counts")
    first = measure(given, "scale 0.17578125 deg/count | derivative | lowpass 50 rad/s")
    last = measure(given, "derivative | lowpass 50 rad/s | scale 0.17578125 deg/count")

    np.testing.assert_allclose(first.y, last.y, rtol=0, atol=1e-10)
    assert first.chain == last.chain == Chain.parse("derivative | lowpass 50 rad/s")
    assert first.output_unit == last.output_unit == "rad/s"


def test_a_scale_without_a_unit_stays_in_the_chain_and_its_meaning_is_reported() -> None:
    data = measure(recording(counts_of(TRAVEL), "counts"), "scale 0.0030679616 | derivative")

    assert data.output_unit == "counts/s"
    assert str(data.chain) == "scale 0.0030679616 | derivative"
    assert codes(data) == {"scale-without-unit": Severity.INFO}
    assert "`scale 0.0030679616 rad/count`" in data.findings[0].sentence


def test_a_scale_from_another_unit_than_the_data_is_refused() -> None:
    with pytest.raises(UsageError, match=r"in rad there.*m/rad"):
        measure(recording(counts_of(TRAVEL), "counts", counts_per_rev=2048), "scale 0.1758 deg/count")


def test_a_tachometer_shorter_than_the_time_between_samples_is_reported() -> None:
    data = measure(recording(TRAVEL, "rad/s", chain="tachometer 0.5 ms"))

    assert codes(data) == {"window-too-short": Severity.INFO}


def test_all_that_is_missing_is_asked_for_at_once() -> None:
    given = replace(recording(TRAVEL, None, t=None), input=None)

    with pytest.raises(MissingInformation) as caught:
        measure(given)

    assert [sentence.split(":")[0] for sentence in caught.value.missing] == [
        "which channel is the input, what drives the motor",
        "the unit of the output 'theta'",
        "the times of the samples",
    ]
    assert "there are 'u', 'theta'" in str(caught.value)
    assert "`output=theta:UNIT`" in str(caught.value)


def test_rows_without_a_number_are_left_out_and_reported() -> None:
    values, times = TRAVEL.copy(), T.copy()
    values[[3, 10]] = np.nan
    times[7] = np.inf

    data = measure(recording(values, "rad", t=times))

    assert len(data.y) == 1997
    assert len(data.u) == 1999
    assert codes(data) == {"rows-left-out": Severity.INFO}
    assert [finding.rows for finding in data.findings] == [(8, 8), (4, 11)]
    assert "3 of 2000 rows" in data.findings[1].sentence


@pytest.mark.parametrize(
    ("times", "rows"), [([0.0, 1.0, 1.0, 2.0], "row 2 (1 s) to row 3 (1 s)"), ([0.0, 2.0, 1.0, 3.0], "row 2")]
)
def test_times_that_do_not_increase_are_reported_with_their_rows(times: list[float], rows: str) -> None:
    with pytest.raises(UsageError) as caught:
        measure(recording(np.arange(4.0), "rad", t=np.array(times)))
    assert rows in str(caught.value)


@pytest.mark.parametrize(
    ("unit", "symbol"), [("A", "A"), ("N·m", "N·m"), ("V", "V"), ("rad/s^2", "rad"), ("s", "s"), ("1", "1")]
)
def test_an_output_that_is_no_motion_is_refused(unit: str, symbol: str) -> None:
    with pytest.raises(UsageError, match="expected the unit of a position") as caught:
        measure(recording(TRAVEL, unit))
    assert symbol in str(caught.value)


@pytest.mark.parametrize(
    ("counts_per_rev", "counter_bits"),
    [(0.0, None), (-2048.0, None), (np.nan, None), (2048.0, 0), (2048.0, 99)],
)
def test_an_encoder_that_can_not_be_is_refused(counts_per_rev: float, counter_bits: int | None) -> None:
    with pytest.raises(UsageError, match="expected a"):
        measure(
            recording(counts_of(TRAVEL), "counts", counts_per_rev=counts_per_rev, counter_bits=counter_bits)
        )


def test_two_samples_are_enough_and_one_is_not() -> None:
    assert len(measure(recording(np.array([0.0, 1.0]), "counts", t=T[:2], counter_bits=16)).y) == 2
    with pytest.raises(NotIdentifiable, match="at least two"):
        measure(recording(np.array([0.0]), "counts", t=T[:1]))
    with pytest.raises(UsageError, match="no row"):
        measure(recording(np.array([]), "counts", t=T[:0]))


def test_the_recording_is_left_as_it_was() -> None:
    given = recording(counts_of(TRAVEL), "counts", counter_bits=16, counts_per_rev=2048)

    measure(given, "derivative | lowpass 50 rad/s | scale 2")

    np.testing.assert_array_equal(given["theta"].values, counts_of(TRAVEL))
