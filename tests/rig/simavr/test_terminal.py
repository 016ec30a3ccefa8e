"""The rig by a pseudo-terminal, with pyserial and the operating system between: asserted in device time all the same."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from servobench.rig.devices.rig import Rig, RigSettings
from tests.rig.simavr.board import MS, motor
from tests.rig.simavr.build import needed
from tests.rig.simavr.terminal import terminal

pytestmark = pytest.mark.usefixtures("simavr")

HOST = """
import sys
from servobench.rig.devices.rig import Rig, RigSettings
with Rig(RigSettings(port=sys.argv[1], batch=False)) as rig:
    rig.start(0.004, None)
    while True:
        sample = rig.read()
        rig.write(6.0)
        if sample.index == 60:
            print("turning", flush=True)
"""


@pytest.fixture(scope="module")
def simavr() -> None:
    needed()


def kill_a_host(number: signal.Signals) -> float:
    """Kill a process that drives the rig in direct mode; return the device time from its last byte to the cut [ms]."""
    with terminal() as rig:
        host = subprocess.Popen([sys.executable, "-c", HOST, rig.port], stdout=subprocess.PIPE, text=True)
        with host:
            assert host.stdout
            assert host.stdout.readline() == "turning\n"
            turning = rig.look()
            assert turning["duty"] == 0.5
            host.send_signal(number)
            before = turning["cycle"]
            # In device time, however slowly that passes here: a watchdog's time and much more.
            while (now := rig.look())["cycle"] - before < 400 * MS:
                time.sleep(0.01)
            host.kill()
        assert not now["enable"]
        assert now["duty"] == 0
        assert now["speed"] < turning["speed"]
        return float(now["pwm_high"] - now["received"]) / MS


@pytest.mark.parametrize("name", ["SIGKILL", "SIGSTOP"])
def test_a_host_that_is_killed_or_stopped_leaves_the_motor_without_voltage(name: str) -> None:
    # The bytes of the last frame are handed to the chip one after the other: the cut counts from the last of them.
    assert kill_a_host(signal.Signals[name]) <= 51


@pytest.mark.long
def test_twenty_hosts_that_are_killed_leave_the_motor_without_voltage() -> None:
    assert max(kill_a_host(signal.SIGKILL) for _ in range(20)) <= 51


def test_a_host_that_ends_in_good_order_switches_the_bridge_off_at_once() -> None:
    with terminal() as rig:
        with Rig(RigSettings(port=rig.port, batch=False, watchdog=0.5)) as device:
            device.start(0.004, None)
            for _ in range(30):
                device.read()
                device.write(6.0)
        before = rig.look()
        while (now := rig.look())["cycle"] - before["cycle"] < 20 * MS:
            time.sleep(0.005)
        assert not now["enable"]
        assert (now["pwm_high"] - now["received"]) / MS < 5


def test_two_programs_can_not_have_the_same_port() -> None:
    from servobench.core.errors import DeviceError

    with (
        terminal() as rig,
        Rig(RigSettings(port=rig.port)),
        pytest.raises(DeviceError, match="can't be opened"),
    ):
        Rig(RigSettings(port=rig.port)).__enter__()


@pytest.mark.long
def test_a_position_loop_at_250_hz_has_no_gap_in_its_samples_for_ten_seconds() -> None:
    with terminal() as rig, Rig(RigSettings(port=rig.port, batch=False, watchdog=0.5)) as device:
        device.start(0.004, None)
        indices, counts, before = [], 0, 0
        for _ in range(2500):
            sample = device.read()
            indices.append(sample.index)
            before, counts = counts, sample.counts
            device.write(0.02 * (1000 - counts) - 0.04 * (counts - before))
        assert device._talk is not None
        assert device._talk.lost == device._talk.damaged == 0
    assert indices == list(range(2500))
    assert abs(counts - 1000) <= 15


def identified(folder: Path, seed: int) -> tuple[str, dict[str, float], list[str]]:
    """Run the command on a motor drawn from a seed; return the verdict, how far off each value is, in half intervals, and why."""
    drawn = random.Random(seed)
    around = {
        "resistance": drawn.uniform(4, 9),
        "constant": drawn.uniform(0.03, 0.05),
        "inertia": drawn.uniform(1e-5, 4e-5),
        "coulomb": drawn.uniform(2e-4, 8e-4),
        "start": drawn.random(),
    }
    out = folder / str(seed)
    with terminal(**around) as rig:
        done = subprocess.run(
            [
                sys.executable,
                "-m",
                "servobench",
                "run",
                "--device",
                f"rig:{rig.port} watchdog=500ms",
                "--out",
                str(out),
            ],
            capture_output=True,
            text=True,
            env={**os.environ, "OPENBLAS_CORETYPE": "SkylakeX"},
        )
    assert done.returncode == 0, done.stderr + done.stdout
    result = json.loads((out / "result.json").read_text())
    truth = motor(**around).truth
    off = {}
    for name in ("gain", "time_constant", "coulomb_voltage"):
        low, high = result["parameters"][name]["interval"]
        off[name] = (truth[name] - (low + high) / 2) / ((high - low) / 2)
    why = [each["sentence"] for each in result["findings"] if each["severity"] != "info"]
    return result["verdict"], off, why


@pytest.mark.long
def test_the_command_trusts_20_of_20_motors_and_its_intervals_hold_their_truth(tmp_path: Path) -> None:
    found = [identified(tmp_path, seed) for seed in range(20)]

    assert [verdict for verdict, _, _ in found] == ["trusted"] * 20, [why for _, _, why in found]
    for name in ("gain", "time_constant", "coulomb_voltage"):
        assert sum(abs(off[name]) <= 1 for _, off, _ in found) >= 18, found
