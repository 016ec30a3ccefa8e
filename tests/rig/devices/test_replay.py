from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from servobench.core.channels import Channel
from servobench.core.errors import FormatError, UsageError
from servobench.recordings.native.writer import save
from servobench.recordings.recording import Recording, Series, Source
from servobench.rig.devices.replay import Replay
from servobench.rig.devices.twin import Twin
from servobench.rig.experiment import Experiment
from servobench.rig.loop.run import run


@pytest.fixture(scope="module")
def original() -> Recording:
    """Return half a second of the twin."""
    with Twin(Twin.Settings(tachometer=True)) as motor:
        return run(Experiment(duration=0.5), motor)


def series(name: str, unit: str | None, values: list[float], t: list[float] | None) -> Series:
    times = None if t is None else np.array(t)
    return Series(channel=Channel(name=name, unit=unit), values=np.array(values), t=times)


def foreign(**changes: object) -> Recording:
    """Return somebody's recording whose input changes at other times than its output is sampled."""
    given = {
        "name": "foreign",
        "series": (
            series("pwm", "%", [10.0, 20.0, 30.0], [0.5, 1.0, 2.5]),
            series("enc", "counts", [0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 2.0, 3.0]),
        ),
        "source": Source(name="log.csv"),
        "input": "pwm",
        "output": "enc",
    }
    return Recording(**{**given, **changes})  # type: ignore[arg-type]


def test_a_replayed_run_gives_what_was_recorded(original: Recording) -> None:
    with Replay(original) as device:
        again = run(Experiment(duration=10), device)

    for name in ("applied", "counts", "tachometer", "current"):
        assert np.array_equal(again[name].values, original[name].values)
        assert np.array_equal(again[name].t, original[name].t)  # type: ignore[arg-type]
    assert again.stopped.reason == "finished"
    assert again.stopped.sentence == "the replayed recording 'run' ended after 250 samples"


def test_what_a_controller_would_have_commanded_stands_beside_what_was_applied(original: Recording) -> None:
    from servobench.systems.signals.constant import Constant

    with Replay(original) as device:
        again = run(Experiment(duration=0.5, signal=Constant(value=-1.0)), device)

    assert set(again["commanded"].values) == {-1.0}
    assert np.array_equal(again["applied"].values, original["applied"].values)


def test_an_experiment_that_is_shorter_ends_as_asked(original: Recording) -> None:
    with Replay(original) as device:
        again = run(Experiment(duration=0.1), device)

    assert len(again["counts"].values) == 50


def test_an_input_at_other_times_is_played_as_it_held() -> None:
    with Replay(foreign(input_before=5.0)) as device:
        played = run(Experiment(duration=10, sample_time=1.0), device)

    assert played["applied"].values.tolist() == [5.0, 20.0, 20.0, 30.0]
    assert played["applied"].channel.unit == "%"
    assert played["counts"].values.tolist() == [0.0, 1.0, 2.0, 3.0]
    with Replay(foreign()) as device:  # without a word on what was before, it's the first value
        assert run(Experiment(duration=10, sample_time=1.0), device)["applied"].values[0] == 10.0


def test_a_recording_without_times_is_played_at_the_sample_time() -> None:
    plain = foreign(series=(series("pwm", "V", [1.0, 2.0], None), series("enc", "counts", [3.0, 4.0], None)))

    with Replay(plain) as device:
        played = run(Experiment(duration=10, sample_time=0.25), device)

    assert played["counts"].t is not None
    assert played["counts"].t.tolist() == [0.0, 0.25]
    assert played["applied"].values.tolist() == [1.0, 2.0]


def test_another_sample_time_than_the_recordings_is_refused_before_anything_is_played(
    original: Recording,
) -> None:
    with Replay(original) as device, pytest.raises(UsageError, match=r"0\.002 s, the run one of 0\.01 s"):
        run(Experiment(sample_time=0.01), device)


@pytest.mark.parametrize(
    ("recording", "said"),
    [
        (foreign(input=None), "input channel isn't declared"),
        (foreign(output=None), "output channel isn't declared"),
        (foreign(output="pwm"), "'pwm' is in %, and a device reads encoder counts"),
        (
            foreign(series=(series("pwm", "V", [1.0], [0.0]), series("enc", "counts", [0.5], [0.0]))),
            r"in row 1 'enc' is 0\.5, which isn't a whole number of counts",
        ),
        (
            foreign(series=(series("pwm", "V", [1.0], [0.0]), series("enc", "counts", [np.nan], [0.0]))),
            "in row 1 'enc' is nan",
        ),
        (
            foreign(
                series=(series("pwm", "V", [1.0], None), series("enc", "counts", [0.0, 1.0], [0.0, 1.0]))
            ),
            "can't be matched",
        ),
        (
            foreign(
                series=(
                    series("pwm", "V", [1.0, 2.0], [1.0, 0.0]),
                    series("enc", "counts", [0.0, 1.0], [0.0, 1.0]),
                )
            ),
            "can't be matched",
        ),
        (
            foreign(series=(series("pwm", "V", [], []), series("enc", "counts", [0.0], [0.0]))),
            "its input has no samples",
        ),
    ],
)
def test_a_recording_that_can_not_be_played_is_refused_with_the_reason(
    recording: Recording, said: str
) -> None:
    with pytest.raises(UsageError, match=said):
        Replay(recording)


def test_a_file_is_played_by_the_name_or_the_place_of_its_recording(
    tmp_path: Path, original: Recording
) -> None:
    path = tmp_path / "a.mcap"
    save([original, foreign(), replace(foreign(), name="twice"), replace(foreign(), name="twice")], path)

    def played(**settings: object) -> str:
        device = Replay(Replay.Settings(file=path, **settings))  # type: ignore[arg-type]
        return dict(device.info.settings)["recording"]

    assert [played(), played(recording=1), played(recording="foreign")] == ["run", "foreign", "foreign"]
    for unknown in ("nothing", 4, "twice"):
        with pytest.raises(UsageError, match="it holds 0: 'run', 1: 'foreign', 2: 'twice', 3: 'twice'"):
            played(recording=unknown)
    with pytest.raises(UsageError):
        played(recording=-1)


def test_a_file_of_another_kind_is_refused_with_what_to_do(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,u,y\n0,1,2\n")

    with pytest.raises(FormatError, match="servobench convert"):
        Replay(Replay.Settings(file=path))
