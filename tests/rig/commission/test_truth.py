"""The measurements of checks agree with the twin's settings, which are known exactly."""

import pytest

from tests.rig.commission.benches import (
    DeadWatchdogTwin,
    EarlyTwin,
    HastyStallTwin,
    NarrowTwin,
    OneWayTwin,
    SimulatedPerson,
    TurnedTwin,
    WeakWatchdogTwin,
    commissioned,
)

RESISTANCE, CONSTANT = 8.4, 0.042  # of the twin's data sheet: Ω, V·s/rad
INDUCTANCE = 1.16e-3  # H


@pytest.mark.parametrize("torque", [4e-4, 8e-4, 3e-3])
@pytest.mark.parametrize("dead_band", [0.0, 0.5])
def test_the_dead_band_lies_in_its_interval(torque: float, dead_band: float) -> None:
    """By statics: the shaft turns from u = R T / k + the amplifier's dead band on."""
    found = commissioned(coulomb_torque=torque, dead_band=dead_band)
    truth = RESISTANCE * torque / CONSTANT + dead_band
    moved, _ = found.figure("stop", "voltage of the pulse")

    for way in ("forwards", "backwards"):
        _, interval = found.figure("dead_band", f"breakaway voltage {way}")
        assert interval is not None
        assert interval[0] <= truth <= interval[1]
        # Two steps of the staircase, which goes in 24 steps to 1.5 times the voltage that moved the shaft.
        assert interval[1] - interval[0] <= 2 * 1.5 * moved / 24 * (1 + 1e-9)


def test_friction_beyond_a_fifth_of_the_range_is_too_much_and_is_measured_all_the_same() -> None:
    found = commissioned(limit=0.5)
    _, interval = found.figure("dead_band", "breakaway voltage forwards")

    assert found.outcome("dead_band").state == "failed"
    assert interval is not None
    assert interval[0] <= RESISTANCE * 8e-4 / CONSTANT <= interval[1]


@pytest.mark.parametrize("watchdog", [0.02, 0.05, 0.2, 0.5])
def test_the_time_of_the_watchdog_lies_in_its_interval(watchdog: float) -> None:
    found = commissioned(watchdog=watchdog)
    value, interval = found.figure("watchdog", "time until the cut")

    assert found.outcome("watchdog").state == "verified"
    assert interval is not None
    assert interval[0] <= watchdog <= interval[1]
    assert value == pytest.approx(watchdog, abs=0.02)


def test_a_device_that_promises_nothing_has_no_watchdog_and_one_that_does_has_failed() -> None:
    assert commissioned().outcome("watchdog").state == "unsupported"
    assert commissioned(DeadWatchdogTwin).outcome("watchdog").state == "failed"


@pytest.mark.parametrize(
    ("delay", "state"), [(0.0, "verified"), (0.0013, "verified"), (0.004, "failed"), (0.02, "failed")]
)
def test_the_delay_lies_in_its_interval(delay: float, state: str) -> None:
    """A winding's time constant L/R, 0.14 ms, is far shorter than a sample and looks like delay."""
    found = commissioned(delay=delay)
    _, interval = found.figure("delay", "delay")

    assert interval is not None
    assert interval[0] <= delay + INDUCTANCE / RESISTANCE <= interval[1]
    # A third of a sample time: what makes it useful.
    assert interval[1] - interval[0] <= 2 * 0.002 / 3
    assert found.outcome("delay").state == state


@pytest.mark.long
def test_the_interval_of_the_delay_holds_the_truth_in_95_of_100() -> None:
    """Of 60 binomial trials at 0.95 fewer than 53 come once in 300; the parabola's share makes it rarer.

    The delay is measured before the counter, whose runs would take half as long as all of those before.
    """
    held = 0
    for number in range(60):
        delay = 0.0002 * number
        bench = commissioned(delay=delay, torque_noise=1e-6, interrupt="counter")
        _, interval = bench.figure("delay", "delay")
        assert interval is not None
        held += interval[0] <= delay + INDUCTANCE / RESISTANCE <= interval[1]
    assert held >= 53


@pytest.mark.parametrize(("counts", "state"), [(2048, "verified"), (512, "failed"), (8192, "failed")])
@pytest.mark.parametrize("turns", [1, 5])
def test_counts_of_a_turn_are_those_that_the_hand_turned(counts: int, state: str, turns: int) -> None:
    TurnedTwin.person = SimulatedPerson(turns=turns, counts=-turns * counts)
    found = commissioned(TurnedTwin, person=TurnedTwin.person)
    value, interval = found.figure("turns", "counts per turn")

    # A simulated hand is exact to a count.
    assert value == pytest.approx(counts, abs=1 / turns)
    assert interval is not None
    assert interval[0] <= counts <= interval[1]
    assert found.outcome("turns").state == state


def test_a_hand_that_does_not_turn_leaves_it_unknown() -> None:
    TurnedTwin.person = SimulatedPerson(turns=1, counts=0)
    found = commissioned(TurnedTwin, person=TurnedTwin.person)

    assert found.outcome("turns").state == "unknown"


def test_a_counter_of_16_bits_wraps_both_ways_and_one_of_24_is_not_reached() -> None:
    found = commissioned(counter_bits=16)
    assert found.outcome("counter").state == "verified"
    assert found.figure("counter", "width")[0] == 16

    wide = commissioned(counter_bits=24)
    assert wide.outcome("counter").state == "unknown"
    assert "until_wrap" in wide.outcome("counter").remedy


def test_a_counter_that_is_narrower_than_it_says_has_failed() -> None:
    found = commissioned(NarrowTwin, counter_bits=16)

    assert found.outcome("counter").state == "failed"
    assert found.figure("counter", "width")[0] == 16


def test_a_counter_of_24_bits_is_turned_until_it_wraps_if_that_is_wished() -> None:
    found = commissioned(counter_bits=24, until_wrap=True)

    assert found.outcome("counter").state == "verified"
    assert found.figure("counter", "width")[0] == 24


def test_missing_samples_are_no_wraps() -> None:
    found = commissioned(faults=[{"name": "lost", "every": 50}])

    assert found.outcome("counter").state == "unknown"


def test_a_heavy_shaft_that_coasts_is_no_runaway() -> None:
    """A mechanical time constant of 0.6 s, six times that of the twin."""
    found = commissioned(disc_inertia=1e-4)

    assert not found.acceptance.failed


def test_a_coarse_encoder_will_do() -> None:
    assert not commissioned(counts_per_rev=48).acceptance.failed


def test_a_shaft_that_only_slows_down_without_voltages_leaves_the_watchdog_unknown() -> None:
    found = commissioned(WeakWatchdogTwin)

    assert found.outcome("watchdog").state == "unknown"
    assert "can't be distinguished from a load" in found.outcome("watchdog").found


def test_a_counter_that_was_seen_to_wrap_one_way_only_is_unknown() -> None:
    found = commissioned(OneWayTwin, counter_bits=16)

    assert found.outcome("counter").state == "unknown"
    assert "only one way was seen" in found.outcome("counter").found


def test_a_delay_that_is_shorter_than_it_is_said_to_be_has_failed_too() -> None:
    found = commissioned(EarlyTwin)

    assert found.outcome("delay").state == "failed"
    assert found.figure("delay", "delay")[0] == pytest.approx(0.0, abs=0.002)


def test_a_stall_that_is_cut_off_too_early_has_failed() -> None:
    found = commissioned(HastyStallTwin)

    assert found.outcome("stall").state == "failed"
    assert "the board reports a stall" in found.outcome("stall").found


def test_the_sign_of_the_counts_does_not_stop_the_other_checks() -> None:
    found = commissioned(faults=[{"name": "encoder_flipped"}])

    assert [each.name for each in found.acceptance.failed] == ["sign"]
