"""The limits of a run in a report."""

from dataclasses import replace

import pytest

from servobench.identification.result import Result
from servobench.recordings.recording import Recording
from servobench.report.document import Report
from servobench.report.safety import guard_rows
from servobench.rig.devices.guarded import Guarded
from servobench.rig.devices.replay import Replay
from servobench.rig.devices.twin import Twin
from servobench.rig.experiment import Experiment, Limits
from servobench.rig.experiment.limits import StallLimits
from servobench.rig.loop.run import run
from servobench.systems.signals.constant import Constant


def recorded(voltage: float = 2.0, limits: Limits | None = None, **settings: float) -> Recording:
    asked = Experiment(signal=Constant(value=voltage), duration=1.0, limits=limits or Limits())
    with Twin(Twin.Settings(**settings)) as motor:
        return run(asked, motor)


@pytest.mark.promise("S15")
def test_each_limit_stands_there_with_its_number_and_that_nothing_reached_it() -> None:
    rows = {heading: (limit, reached) for heading, limit, reached in guard_rows(recorded())}

    assert rows == {
        "Voltage": ("at most 10 V, clipped", "never"),
        "Current": ("none", "not watched"),
        "Standstill of the encoder": (
            "at most 34 ms while the voltage turns the motor, from 2 V on",
            "never",
        ),
        "Sign of the encoder": (
            "under feedback, a shaft that accelerates against the voltage, as with a reversed encoder",
            "never",
        ),
        "Speed": ("none", "not watched"),
        "Stall": ("slower than 1 rad/s above 5 V: a warning after 40 ms, cut off after 3 s", "never"),
        # 1.5 · 10 V / 0.042 V·s/rad · 0.002 s · 2048 / 2π
        "Step of the encoder": ("at most 233 counts in a sample time, that again, and 2", "never"),
        "Travel": ("none", "not watched"),
        "Watchdog": ("a new voltage within 100 ms", "never"),
    }


@pytest.mark.promise("S15")
def test_what_was_reached_is_reported() -> None:
    strict = Limits(voltage=6.0, slew=1e4, stall=StallLimits(duration=0.5))
    rows = {heading: reached for heading, _, reached in guard_rows(recorded(8.0, strict, coulomb_torque=1.0))}

    assert rows["Voltage"] == rows["Slew"] == "at 250 samples"
    assert rows["Stall"].startswith("The shaft was slower than 1 rad/s under more than 5 V, for up to 0.5 s")
    assert rows["Watchdog"] == "never"


def test_nothing_is_said_where_nothing_was_driven_or_nobody_knows() -> None:
    recording = recorded()
    with Replay(recording) as replay:
        asked = Experiment(signal=Constant(value=2.0), duration=0.5)
        assert guard_rows(run(asked, Guarded(replay))) == ()
    for text in (
        "",
        "[limits]\nvoltage = '10 V'\n",
        "[limits]\nwatchdog = 5\n",
        "[limits]\n[limits.watchdog]\n",
    ):
        assert guard_rows(replace(recording, experiment=text)) == ()
    assert guard_rows(replace(recording, info=None)) == ()


@pytest.mark.promise("S15")
def test_the_page_shows_it(good: Result) -> None:
    page = Report(recorded(), good).html()

    assert "What the motor was guarded by" in page
    assert "a warning after 40 ms, cut off after 3 s" in page
    assert "a switch in the motor's supply remains necessary" in page
