"""A run that ends when the wished interval is reached."""

from __future__ import annotations

from pathlib import Path

import pytest

from servobench.core.errors import UnknownName, UsageError
from servobench.identification.design.stopping_rule import StoppingRule, half, parse_wish
from servobench.identification.identify import identify
from servobench.recordings.measurement.measure import measure
from servobench.rig.devices.twin import Twin, TwinSettings
from servobench.rig.experiment import Experiment, read_experiment
from servobench.rig.loop.run import run
from servobench.systems.signals.prbs import PRBS
from tests.rig.loop.shaft import Shaft

ASKED = Experiment(signal=PRBS(low=1, high=4, bit_time=0.214), duration=30.0)
WOBBLING = TwinSettings(torque_noise=1e-5)


def test_a_wish_is_read() -> None:
    assert parse_wish("gain=0.1%, time_constant = 0.5 %") == pytest.approx(
        {"gain": 0.001, "time_constant": 0.005}
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("time_constant", "expected, for example,"),
        ("time_constant=0.5", "expected, for example,"),
        ("time_constant=half%", "isn't a number"),
        ("gain=0%", "more than 0"),
        ("gain=nan%", "more than 0"),
        ("", "expected, for example,"),
    ],
)
def test_a_wish_that_is_none_is_reported(text: str, expected: str) -> None:
    with pytest.raises(UsageError, match=expected):
        parse_wish(text)


def test_a_parameter_that_nothing_waits_for_is_reported() -> None:
    with pytest.raises(UnknownName, match="time_constant"):
        parse_wish("tau=0.5%")


def test_a_run_ends_at_the_first_look_with_the_wished_interval(tmp_path: Path) -> None:
    rule = StoppingRule(parse_wish("time_constant=0.2%"))
    with Twin(WOBBLING) as twin:
        recording = run(ASKED, twin, to=tmp_path / "run.mcap", look=rule)

    assert recording.stopped.reason == "finished"
    assert "when the target interval was reached: time constant ± 0." in recording.stopped.sentence
    data = measure(recording)
    assert 2.0 <= data.duration < 29.0
    assert rule.looks > 1
    assert half(identify(data), "time_constant") <= 0.002
    # At the look before, with a fifth less data, the interval wasn't there yet.
    assert half(identify(data.part(0.0, data.duration / 1.25)), "time_constant") > 0.002


def test_a_run_whose_wish_is_not_reached_ends_when_its_time_is_over() -> None:
    short = ASKED.model_copy(update={"duration": 5.0})
    with Twin(WOBBLING) as twin:
        recording = run(short, twin, look=StoppingRule(parse_wish("gain=0.0001%")))

    assert recording.stopped.sentence == "ran for 5 s, as asked"
    assert len(recording["counts"].values) == 2500


def test_to_be_looked_at_changes_nothing_in_what_is_recorded() -> None:
    short = ASKED.model_copy(update={"duration": 3.0})
    with Twin(WOBBLING) as twin:
        plain, looked = run(short, twin), run(short, twin, look=lambda recording: None)

    for name in ("counts", "applied", "late"):
        assert (plain[name].values == looked[name].values).all()


def test_what_is_shown_is_the_recording_so_far() -> None:
    seen = []
    short = ASKED.model_copy(update={"duration": 2.0})
    with Twin() as twin:
        recording = run(short, twin, look=seen.append)

    lengths = [len(each["counts"].values) for each in seen]
    assert lengths == sorted(set(lengths))
    assert lengths == [251, 501, 751]
    assert (seen[-1]["counts"].values == recording["counts"].values[:751]).all()


def test_a_motor_beside_the_wall_clock_is_not_held_up() -> None:
    with pytest.raises(UsageError, match="delay its loop"):
        run(ASKED, Shaft(timing="host"), look=lambda recording: None)


def test_the_wish_stands_in_the_file() -> None:
    asked = ASKED.model_copy(update={"until": "gain=1%"})

    assert read_experiment(asked.to_toml()) == asked
