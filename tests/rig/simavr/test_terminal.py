"""The rig by a pseudo-terminal, with pyserial and the operating system between: asserted in device time all the same."""

import json
import random
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from servobench.identification.identify import identify
from servobench.recordings.measurement.measure import measure
from servobench.rig.devices.base import RunEnded
from servobench.rig.devices.rig import Rig, RigSettings
from servobench.rig.experiment import Experiment
from tests import forks
from tests.rig.simavr.board import MS, motor
from tests.rig.simavr.build import needed
from tests.rig.simavr.lockstep import Bench
from tests.rig.simavr.terminal import terminal

pytestmark = pytest.mark.usefixtures("simavr")

# Where it is allowed to, it isn't held up by whatever else the computer does: its watchdog would trip before it is killed.
HOST = """
import os
import sys
from contextlib import suppress
from servobench.rig.devices.rig import Rig, RigSettings
with suppress(AttributeError, OSError):
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
with Rig(RigSettings(port=sys.argv[1], batch=False)) as rig:
    rig.start(0.004, None)
    while True:
        sample = rig.read()
        rig.write(6.0)
        if sample.index == 60:
            print("turning", flush=True)
"""

# What a run says on a computer with other things to do, which can't simulate a chip in real time.
TOO_SLOW = "clocks-disagree"
TOO_LATE = ("find what delayed the loop", "the voltages of a run came too late", "no voltage came for")


@pytest.fixture(scope="module")
def simavr() -> None:
    needed()


def kill_a_host(number: signal.Signals) -> float | None:
    """Kill a process that drives the rig in direct mode; return the device time from its last byte to the cut [ms].

    None where the computer didn't keep up and the host says so.
    """
    with terminal() as rig:
        host = subprocess.Popen(
            [sys.executable, "-c", HOST, rig.port],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        with host:
            assert host.stdout
            assert host.stderr
            if host.stdout.readline() != "turning\n":
                said = host.stderr.read()
                assert any(words in said for words in TOO_LATE), said
                return None
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


def until_cut(number: signal.Signals) -> float:
    """The device time that `kill_a_host` returns, of the first of five hosts that the computer kept up with."""
    return next(cut for _ in range(5) if (cut := kill_a_host(number)) is not None)


@pytest.mark.parametrize("name", ["SIGKILL", "SIGSTOP"])
def test_a_host_that_is_killed_or_stopped_leaves_the_motor_without_voltage(name: str) -> None:
    # The bytes of the last frame are handed to the chip one after the other: the cut counts from the last of them.
    assert until_cut(signal.Signals[name]) <= 51


@pytest.mark.long
def test_twenty_hosts_that_are_killed_leave_the_motor_without_voltage() -> None:
    assert max(until_cut(signal.SIGKILL) for _ in range(20)) <= 51


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
        pytest.raises(DeviceError, match=r"can't be opened \(another program is using it\)"),
    ):
        Rig(RigSettings(port=rig.port)).__enter__()


def position_loop() -> tuple[list[int], int, int] | None:
    """Ten seconds of a P-D loop at 250 Hz: the samples' indices, the frames lost or damaged, and how far the shaft got.

    None where the computer didn't keep up and the board says so. What the board said before it was asked may be cut off.
    """
    with terminal() as rig, Rig(RigSettings(port=rig.port, batch=False, watchdog=0.5)) as device:
        device.start(0.004, None)
        talk = device._talk
        assert talk is not None
        indices, counts, before, at_start = [], 0, 0, talk.lost + talk.damaged
        for _ in range(2500):
            try:
                sample = device.read()
            except RunEnded as ended:
                if any(words in ended.stopped.sentence for words in TOO_LATE):
                    return None
                raise
            indices.append(sample.index)
            before, counts = counts, sample.counts
            device.write(0.02 * (1000 - counts) - 0.04 * (counts - before))
        return indices, talk.lost + talk.damaged - at_start, counts


@pytest.mark.long
def test_a_position_loop_at_250_hz_has_no_gap_in_its_samples_for_ten_seconds() -> None:
    indices, missing, counts = next(filter(None, (position_loop() for _ in range(5))))

    assert indices == list(range(2500))
    assert missing == 0
    assert abs(counts - 1000) <= 15


NAMES = ("gain", "time_constant", "coulomb_voltage")


def drawn_motor(seed: int) -> dict[str, float]:
    drawn = random.Random(seed)
    return {
        "resistance": drawn.uniform(4, 9),
        "constant": drawn.uniform(0.03, 0.05),
        "inertia": drawn.uniform(1e-5, 4e-5),
        "coulomb": drawn.uniform(2e-4, 8e-4),
        "start": drawn.random(),
    }


def check_trusted(found: list[tuple[str, dict[str, tuple[float, float]]]]) -> None:
    """Hold verdicts and intervals of motors, drawn from the seeds 0, 1, ..., against their truth, in nine cases of ten."""
    assert [verdict for verdict, _ in found] == ["trusted"] * len(found)
    truths = [motor(**drawn_motor(seed)).truth for seed in range(len(found))]
    for name in NAMES:
        held = [
            low <= truth[name] <= high
            for (_, intervals), truth in zip(found, truths, strict=True)
            for low, high in [intervals[name]]
        ]
        assert sum(held) >= 0.9 * len(held), (name, held)


# The paper's experiment for half of its time; lock step has all of it.
SQUARE = """
[experiment]
duration = "5 s"
[signal]
type = "square"
low = "1 V"
high = "3 V"
frequency = "0.4 Hz"
"""


def run_command(folder: Path, seed: int) -> tuple[str, dict[str, tuple[float, float]]] | None:
    """Run the command on a motor; return verdict and intervals, None where the computer didn't keep up and the run says so."""
    out, experiment = folder / str(seed), folder / f"{seed}.toml"
    experiment.write_text(SQUARE)
    with terminal(**drawn_motor(seed)) as rig:
        words = [
            "run",
            str(experiment),
            "--device",
            f"rig:{rig.port} watchdog=500ms",
            "--out",
            str(out),
            "--overwrite",
        ]
        done = forks.run(["-m", "servobench", *words], cwd=Path.cwd())
    said = " ".join((done.stdout + done.stderr).split())
    if done.returncode == 4 and any(words in said for words in TOO_LATE):
        return None
    assert done.returncode == 0, done.stderr + done.stdout
    result = json.loads((out / "result.json").read_text())
    if TOO_SLOW in [each["code"] for each in result["findings"]]:
        return None
    return result["verdict"], {name: result["parameters"][name]["interval"] for name in NAMES}


@pytest.mark.long
def test_the_command_trusts_10_of_10_motors_and_its_intervals_hold_their_truth(tmp_path: Path) -> None:
    """In real time, at a terminal; what another ten motors would show, lock step shows below without waiting for seconds."""

    def first(seed: int) -> tuple[str, dict[str, tuple[float, float]]]:
        # A computer with other things to do can't simulate a chip in real time: such a run, which names it, is done again.
        return next(filter(None, (run_command(tmp_path, seed) for _ in range(5))))

    with ThreadPoolExecutor(3) as several:
        found = list(several.map(first, range(10)))

    check_trusted(found)


@pytest.mark.long
def test_20_of_20_motors_are_trusted_in_lock_step_and_their_intervals_hold_their_truth() -> None:
    found = []
    for seed in range(20):
        bench = Bench(motor(**drawn_motor(seed)))
        with bench.rig() as rig:
            result = identify(measure(bench.run(Experiment(), rig)))
        found.append((result.verdict.value, {name: result[name].interval for name in NAMES}))

    check_trusted(found)


def commissioned(folder: Path) -> dict[str, str] | None:
    """The state of each check, by `servobench commission`; None where the computer didn't keep up and a check says so."""
    with terminal() as rig:
        words = ["commission", f"rig:{rig.port} watchdog=200ms", "--out", str(folder), "--yes", "--json"]
        done = forks.run(["-m", "servobench", *words], cwd=Path.cwd())
    checks = json.loads(done.stdout)["checks"]
    late = [
        each for each in checks if each["state"] == "unknown" and any(x in each["found"] for x in TOO_LATE)
    ]
    return None if late else {each["name"]: each["state"] for each in checks}


@pytest.mark.long
def test_the_command_commissions_the_rig(tmp_path: Path) -> None:
    states = next(filter(None, (commissioned(tmp_path / str(number)) for number in range(5))))

    assert states.pop("turns") == "unknown"  # nobody is there
    assert states.pop("counter") == "unknown"  # 32 bits take a day
    assert set(states.values()) == {"verified"}
    assert len(states) == 10
