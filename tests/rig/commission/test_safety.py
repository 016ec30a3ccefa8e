"""Nothing spins until stopping is proved, and every way out ends at rest."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import pytest

from servobench.core.errors import DeviceError, UsageError
from servobench.recordings.recording import Recording
from servobench.rig.commission.bench import PULSE_PART, PULSE_TIME, Bench, Interlock
from servobench.rig.commission.checks.base import CHECKS, in_order
from servobench.rig.devices.replay import Replay
from servobench.rig.devices.twin import Twin
from servobench.rig.experiment import Experiment
from servobench.rig.experiment.experiment import DeviceChoice
from servobench.rig.loop.run import run
from tests.rig.commission.benches import (
    Commissioned,
    DeadWatchdogTwin,
    OffsetTwin,
    RunawayTwin,
    commissioned,
)

LIMIT = 10.0  # V; the twin's range
NAMES = [name for name, _ in in_order()]
DRIVING = [name for name in NAMES if CHECKS[name].place >= 30 and name != "turns"]


@cache
def sound() -> Commissioned:
    """A twin with a watchdog at which nothing is wrong; tests only read what came out."""
    return commissioned(watchdog=0.05)


def before(found: Commissioned, check: str) -> list[float]:
    """The voltages that reached a motor for checks that come before one."""
    earlier = set(NAMES[: NAMES.index(check)])
    return [abs(voltage) for name, voltage in found.put_out if name in earlier]


@pytest.mark.promise("S66")
def test_no_voltage_but_zero_goes_out_before_a_pulse_and_none_but_pulses_before_a_stop_was_seen() -> None:
    found = sound()

    assert len(before(found, "stop")) > 1000
    assert set(before(found, "stop")) == {0.0}
    pulses = [voltage for name, voltage in found.put_out if name == "stop"]
    assert 0 < max(pulses) <= PULSE_PART * LIMIT
    assert sum(voltage != 0 for voltage in pulses) <= PULSE_TIME / 0.002
    moved, _ = found.figure("stop", "voltage of the pulse")
    assert max(before(found, "turns")) <= 3 * moved * (1 + 1e-9)
    assert max(abs(voltage) for _, voltage in found.put_out) <= 0.5 * LIMIT


@pytest.mark.promise("S66")
@pytest.mark.parametrize(
    ("kind", "last"), [(OffsetTwin, "rest"), (RunawayTwin, "stop"), (DeadWatchdogTwin, "watchdog")]
)
def test_where_a_stop_is_not_proved_nothing_is_driven_any_more(kind: type[Twin], last: str) -> None:
    found = commissioned(kind)

    assert found.outcome(last).state == "failed"
    assert {name for name, _ in found.put_out} == set(NAMES[: NAMES.index(last) + 1])
    assert found.acceptance.ended
    later = [each.outcome for each in found.acceptance.checks[NAMES.index(last) + 1 :]]
    assert {each.state for each in later} == {"unknown"}
    assert all("Not carried out" in each.found for each in later)


@pytest.mark.promise("S67")
@pytest.mark.parametrize("name", NAMES[:5] + NAMES[6:])
def test_ctrl_c_in_any_check_ends_at_rest_and_keeps_what_was_found(name: str) -> None:
    found = commissioned(watchdog=0.05, interrupt=name)

    assert found.acceptance.interrupted
    assert found.outcome(name).state == "unknown"
    assert all(found.at_rest)
    states = [each.outcome.state for each in found.acceptance.checks]
    place = NAMES.index(name)
    assert set(states[place:]) == {"unknown"}
    assert {name for name, _ in found.put_out} <= set(NAMES[: place + 1])
    assert found.acceptance.checks[place].recordings


def lost_at(check: str) -> Commissioned:
    """A bench whose device is unplugged in the first run of a check, at once after its first 0.25 s."""
    carry_out = Bench._run

    def run_or_lose(bench: Bench, asked: Experiment, **options: Any) -> Any:
        if asked.name == f"commission: {check}":
            faults = (*asked.device.faults, {"name": "device_unplugged", "from": 0.25})
            asked = asked.model_copy(update={"device": asked.device.model_copy(update={"faults": faults})})
        return carry_out(bench, asked, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Bench, "_run", run_or_lose)
        return commissioned(watchdog=0.05)


@pytest.mark.promise("S67")
@pytest.mark.parametrize("name", NAMES[:5] + NAMES[6:])
def test_a_device_that_is_lost_in_any_check_ends_everything_at_rest(name: str) -> None:
    found = lost_at(name)

    assert found.outcome(name).state == "failed"
    assert "no longer responds" in found.outcome(name).found
    assert all(found.at_rest)
    assert {name for name, _ in found.put_out} <= set(NAMES[: NAMES.index(name) + 1])
    assert found.acceptance.failed


@pytest.mark.promise("S67")
@pytest.mark.parametrize(
    "settings",
    [
        {"faults": [{"name": "encoder_flipped"}]},
        {"faults": [{"name": "stuck_channel", "from": "0.25 s"}]},
        {"faults": [{"name": "blocked_shaft"}]},
        {"faults": [{"name": "encoder_unplugged", "from": "0.3 s"}]},
        {"faults": [{"name": "slow_read", "takes": "10 ms", "every": 20}]},
        {"coulomb_torque": "12 mN·m"},
        {"torque_noise": 1e-4},
        {"delay": "30 ms"},
    ],
    ids=str,
)
def test_whatever_is_wrong_every_run_ends_at_rest(settings: dict[str, Any]) -> None:
    found = commissioned(**settings)

    assert all(found.at_rest)
    assert [each.name for each in found.acceptance.checks] == NAMES


class Greedy:
    """A check that asks for what it hasn't earned."""

    def __init__(self, *segments: tuple[float, float]) -> None:
        self.segments = segments

    def carry_out(self, bench: Bench) -> None:
        bench.drive(*self.segments)


def bench(opened: list[Experiment]) -> Bench:
    """A bench before its first check, and the experiments that it had carried out."""
    choice = DeviceChoice(name="twin")

    def carry_out(asked: Experiment, name: str, look: object) -> Recording:
        opened.append(asked)
        with Twin() as motor:
            return run(asked, motor)

    return Bench(Twin(), choice, carry_out)


@pytest.mark.promise("S66")
@pytest.mark.parametrize(
    ("proved", "segments"),
    [
        ((), [(0.1, 0.01)]),
        (("rest",), [(4.1, 0.1)]),
        (("rest",), [(1.0, 0.11)]),
        (("rest",), [(1.0, 0.06), (0.0, 0.1), (-1.0, 0.06)]),
        (("rest", "stop"), [(0.7, 1.0)]),
        (("rest", "stop", "watchdog"), [(10.1, 1.0)]),
        (("rest", "stop", "watchdog"), [(1.0, 1.0), (float("nan"), 1.0)]),
    ],
)
def test_a_check_that_asks_for_more_than_is_proved_opens_no_device(
    proved: Sequence[str], segments: list[tuple[float, float]]
) -> None:
    opened: list[Experiment] = []
    early = bench(opened)
    early.outcomes = {name: sound().outcome(name) for name in proved}
    early.begin("greedy")

    with pytest.raises(Interlock, match=r"allowed|before a stop was seen"):
        Greedy(*segments).carry_out(early)

    assert not opened


@pytest.mark.promise("S66")
@pytest.mark.parametrize(
    "limits", [{"start": {"voltage": 1.0}}, {"terminate": {"voltage": 1.0}}, {"voltage": 12.0}]
)
def test_a_check_can_not_change_what_is_put_out_by_the_way(limits: dict[str, Any]) -> None:
    opened: list[Experiment] = []
    early = bench(opened)
    early.begin("sly")

    with pytest.raises(Interlock, match="no monitor"):
        early.drive((0.0, 1.0), limits=limits)

    assert not opened


def test_a_device_that_nothing_drives_can_not_be_commissioned() -> None:
    with Twin() as motor:
        recording = run(Experiment(duration=0.1), motor)

    with pytest.raises(UsageError, match="nothing can drive it"):
        Bench(Replay(recording), DeviceChoice(name="replay"), lambda *_: recording)


@pytest.mark.parametrize("limit", [0.0, -1.0, float("nan"), float("inf")])
def test_a_voltage_limit_is_above_zero(limit: float) -> None:
    with pytest.raises(UsageError, match="expected one above 0 V"):
        commissioned(limit=limit)


def test_a_voltage_limit_holds_for_everything() -> None:
    found = commissioned(limit=2.0, watchdog=0.05)

    assert max(abs(voltage) for _, voltage in found.put_out) <= 1.0
    assert not found.acceptance.failed


def test_a_device_that_can_not_be_opened_is_an_error_and_no_outcome() -> None:
    class Absent(Twin):
        def __enter__(self) -> "Absent":
            raise DeviceError("twin: nobody there")

    with pytest.raises(DeviceError, match="nobody there"):
        commissioned(Absent)


@pytest.mark.parametrize(("every", "expected"), [(20, "unknown"), (70, "verified")])
def test_a_computer_that_is_too_late_is_reported_from_a_bench_that_fails(every: int, expected: str) -> None:
    found = commissioned(faults=[{"name": "slow_read", "takes": "10 ms", "every": every}])

    assert found.outcome("rest").state == expected
    if expected == "unknown":
        assert "missed" in found.outcome("rest").found
        assert "was cut short" in found.acceptance.ended
        assert {name for name, _ in found.put_out} == {"rest"}
    else:
        assert found.outcome("timing").state == "failed"
