"""The twin: what it counts, when a voltage acts, and what its settings change."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from servobench.core.errors import DeviceError, SimulationDiverged, UnknownName, UsageError
from servobench.rig.devices.base import connect
from servobench.rig.devices.twin import Twin, TwinSettings
from servobench.rig.motor.parameters import DATA_SHEETS
from tests.rig.motor.reference import Truth, march

H = 0.002
QUANTUM = 2 * math.pi / 2048


def driven(twin: Twin, voltages: list[float], seed: int | None = 0) -> list[int]:
    """The counts latched before each voltage acts."""
    counts = []
    with twin:
        twin.start(H, seed)
        for voltage in voltages:
            counts.append(twin.read().counts)
            twin.write(voltage)
    return counts


def test_the_twin_counts_what_the_reference_motor_counts() -> None:
    u = np.repeat([3.0, -3.0, 1.0, -0.5], 100)
    inertia = DATA_SHEETS["qube_servo_2"].motor.inertia
    expected = np.floor(march(Truth(inertia=inertia), u, H, step=1e-6)[:, 2] / QUANTUM)
    found = np.array(driven(Twin(), u.tolist()))
    # The two motors agree to a hundredth of a count, so a count may differ by one only where a floor is that near.
    assert np.abs(found - expected).max() <= 1
    assert np.count_nonzero(found != expected) <= 0.05 * len(u)


def test_a_voltage_written_after_a_sample_moves_the_next_sample_and_not_its_own() -> None:
    counts = driven(Twin(), [0.0, 0.0, 10.0, 10.0, 10.0])
    assert counts[:3] == [0, 0, 0]
    assert counts[3] > 0


@pytest.mark.parametrize(("ticks", "first"), [(0.0, 1), (1.0, 2), (2.0, 3)])
def test_a_delay_moves_the_first_motion_by_its_ticks(ticks: float, first: int) -> None:
    counts = driven(Twin(TwinSettings(delay=ticks * H)), [10.0] * 8)
    moved = next(n for n, count in enumerate(counts) if count != 0)
    assert moved == first


def test_a_fractional_delay_is_the_record_of_an_undelayed_motor_shifted_by_it() -> None:
    """At half the tick, the motor delayed by a tick of it reads what the other reads a tick later."""
    plain = driven(Twin(), [4.0] * 40)
    with Twin(TwinSettings(delay=0.5 * H)) as late:
        late.start(H, None)
        for _ in range(20):
            late.read()
            late.write(4.0)
        late.coast(0.5 * H)
        angle = late.state.angle
    # 19 ticks and a half after the first write acted, half a tick late: 19 ticks of motion.
    assert math.floor(angle / QUANTUM) == plain[19]


def test_the_counter_wraps_at_its_width() -> None:
    counts = driven(Twin(TwinSettings(counter_bits=16)), [10.0] * 400)
    steps = [b - a for a, b in pairwise(counts)]
    assert max(counts) <= 32767
    assert min(steps) < -60000  # one wrap
    assert sum(step < 0 for step in steps) == 1


def test_the_same_seed_gives_the_same_counts_and_another_seed_others() -> None:
    settings = TwinSettings(torque_noise=1e-4, current_noise=0.01)
    first, again, other = (driven(Twin(settings), [3.0] * 200, seed) for seed in (1, 1, 2))
    assert first == again
    assert first != other


def test_a_saturated_voltage_is_reported_as_applied() -> None:
    with Twin() as twin:
        twin.start(H, None)
        twin.read()
        assert twin.write(25.0) == 10.0
        assert twin.write(-25.0) == -10.0


def test_the_dead_band_of_the_newer_unit_swallows_half_a_volt() -> None:
    settings = TwinSettings(motor="qube_servo_3", coulomb_torque=0.0, viscous_friction=0.0)
    assert set(driven(Twin(settings), [0.5] * 100)) == {0}
    assert driven(Twin(settings), [0.8] * 100)[-1] > 0


def test_after_stop_the_shaft_comes_to_rest_and_stays() -> None:
    with Twin() as twin:
        twin.start(H, None)
        for _ in range(100):
            twin.read()
            twin.write(10.0)
        assert twin.state.speed > 50
        twin.stop()
        assert twin.coast(5.0).speed == 0.0
        angle = twin.state.angle
        assert twin.coast(5.0).angle == angle


@pytest.mark.parametrize("voltage", [math.nan, math.inf, -math.inf, "3", None, True])
def test_what_is_no_voltage_never_reaches_the_motor(voltage: object) -> None:
    with Twin() as twin:
        twin.start(H, None)
        twin.read()
        with pytest.raises(UsageError, match="isn't a voltage"):
            twin.write(voltage)  # type: ignore[arg-type]
        twin.read()
        assert twin.state.speed == 0.0


def test_a_twin_that_is_not_connected_refuses_to_run() -> None:
    with pytest.raises(DeviceError, match="with statement"):
        Twin().start(H, None)


def test_connect_refuses_unknown_devices_and_settings_by_name() -> None:
    with pytest.raises(UnknownName, match="twin"):
        connect("twinn")
    with pytest.raises(UsageError, match=r"twin: coulomb_torq"):
        connect("twin", coulomb_torq=1.0)
    with pytest.raises(UsageError, match=r"twin: resistance.*ohm"):
        connect("twin", resistance="8 V")
    with pytest.raises(UnknownName, match="qube_servo_2"):
        connect("twin", motor="qube")
    with pytest.raises(UsageError, match=r"replay: its setting 'file' is missing: a native file"):
        connect("replay")


def test_a_solver_that_would_diverge_says_so_at_the_start_of_the_run() -> None:
    with Twin(TwinSettings(solver="euler")) as twin, pytest.raises(SimulationDiverged, match="L/R"):
        twin.start(H, None)
    with Twin(TwinSettings(solver="euler", inductance="0 H")) as twin:  # type: ignore[arg-type]
        twin.start(H, None)
        twin.read()


def test_beside_the_wall_clock_the_motor_moves_on_whether_or_not_it_is_read() -> None:
    """Two ticks pass between two reads, as after a missed one: the counts are those of two ticks."""
    now = [0.0]
    twin = Twin(TwinSettings(timing="host"))
    twin._clock = lambda: now[0]
    with twin:
        twin.start(H, None)
        twin.read()
        twin.write(5.0)
        now[0] = 20 * H
        sample = twin.read()
    assert sample.time == pytest.approx(20 * H)
    assert sample.counts == driven(Twin(), [5.0] * 21)[20]


def test_a_twin_that_is_entered_again_wants_a_new_start() -> None:
    twin = Twin()
    with twin:
        twin.start(H, None)
        twin.read()
    with twin, pytest.raises(UsageError, match="start"):
        twin.read()


def test_an_encoder_without_counts_is_refused() -> None:
    with pytest.raises(UsageError, match="counts_per_rev"):
        Twin(TwinSettings(counts_per_rev=0))


def test_beside_the_wall_clock_nothing_is_left_to_compile_for_a_call_of_the_device(tmp_path: Path) -> None:
    """A call that compiles looks like a device that doesn't answer, and whoever stands there is told to switch off the supply."""
    program = """
import time
from servobench.core.compiled import announce_compilations
from servobench.rig.devices.twin import Twin, TwinSettings
compiled = []
with announce_compilations(compiled.append, lambda: None):
    twin = Twin(TwinSettings(timing="host"))
    before = len(compiled)
    with twin:
        twin.start(0.002, None)
        for voltage in (2.0, -2.0, 0.0):
            twin.read()
            twin.write(voltage)
            time.sleep(0.003)
print(before, len(compiled) - before)
"""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    before, after = map(int, done.stdout.split())
    assert before > 0
    assert after == 0


def test_its_watchdog_lets_the_motor_go_at_its_time_and_voltages_do_nothing_until_the_next_start() -> None:
    with Twin(TwinSettings(watchdog="50 ms")) as motor, Twin() as other:
        for twin in (motor, other):
            twin.start(0.002, 0)
            for _ in range(500):
                twin.read()
                twin.write(3.0)
        cut = motor.read().counts, other.read().counts
        other.write(3.0)
        assert cut[0] == cut[1]
        for _ in range(25):  # of the voltage before: 50 ms are over at the last of them
            same = motor.read().counts, other.read().counts
        assert same[0] == same[1]
        for _ in range(1000):
            motor.read()
        assert motor.state.speed == 0.0
        assert motor.write(3.0) == 0.0
        motor.read()
        assert motor.state.speed == 0.0

        motor.start(0.002, 0)
        motor.read()
        assert motor.write(3.0) == 3.0


def test_a_twin_without_a_watchdog_promises_none() -> None:
    assert Twin().own_watchdog is None
