"""Row 28: an exception in somebody's controller, SIGTERM, Ctrl-C. Zero volts within 20 ms of device time, then closed."""

import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from servobench.cli.run import terminate_like_ctrl_c
from servobench.core.errors import DeviceError
from servobench.recordings.native.reader import read
from servobench.rig.devices.twin import Twin
from servobench.rig.loop.run import run
from tests.rig.loop.shaft import Controller, odd

SAMPLE_TIME = 0.002  # s
AT = 400  # the tick in which it happens, at speed
WITHIN = 0.02  # s
LONG = 2.0  # s, by when the shaft stands


def coasted(cut_after: float) -> float:
    """Return how far a shaft coasts that was driven with 5 V to that tick and cut off some time [s] later [rad]."""
    with Twin() as motor:
        motor.start(SAMPLE_TIME, 0)
        for _ in range(AT):
            motor.read()
            motor.write(5.0)
        motor.read()
        for _ in range(round(cut_after / SAMPLE_TIME)):
            motor.write(5.0)
            motor.read()
        motor.write(0.0)
        return motor.coast(LONG).angle


def interrupt() -> None:
    raise KeyboardInterrupt


def terminate() -> None:
    os.kill(os.getpid(), signal.SIGTERM)
    # Python hands a signal on between two of its instructions.
    for _ in range(1000):
        pass


def mistake() -> None:
    raise ZeroDivisionError("a mistake in somebody's controller")


@pytest.mark.promise("S17")
@pytest.mark.parametrize(
    ("what", "reason"),
    [(mistake, "error"), (interrupt, "interrupted"), (terminate, "interrupted")],
    ids=["exception", "Ctrl-C", "SIGTERM"],
)
def test_the_shaft_coasts_from_within_20_ms_and_device_and_file_are_closed(
    tmp_path: Path, what: Callable[[], Any], reason: str
) -> None:
    asked = odd(
        controller=Controller(lambda k: what() if k == AT else 5.0), samples=1000, sample_time=SAMPLE_TIME
    )
    with terminate_like_ctrl_c(), Twin() as motor:
        if reason == "error":
            with pytest.raises(ZeroDivisionError):
                run(asked, motor, to=tmp_path / "run.mcap")
        else:
            run(asked, motor, to=tmp_path / "run.mcap")
        angle = motor.coast(LONG).angle

    # A shaft that was cut off later would have come further.
    assert coasted(0.0) - 1e-9 <= angle <= coasted(WITHIN)
    assert coasted(WITHIN) - coasted(0.0) > 1.0  # rad; so the bound means something
    with pytest.raises(DeviceError, match="isn't connected"):
        motor.read()
    (recording,) = read(tmp_path / "run.mcap")
    assert recording.stopped.reason == reason
    assert len(recording["counts"].values) == AT
