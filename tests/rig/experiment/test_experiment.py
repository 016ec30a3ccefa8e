"""An experiment's fields, refusals and findings."""

import pickle  # noqa: TID251 - a process that runs the loop gets its experiment this way

import pytest
from pydantic import ValidationError

from servobench.rig.experiment import PAPER, Experiment, Limits
from servobench.rig.experiment.limits import Outputs
from servobench.systems.control.open_loop import OpenLoop
from servobench.systems.signals.constant import Constant
from servobench.systems.signals.prbs import PRBS
from servobench.systems.signals.ramp import Ramp
from servobench.systems.signals.sine import Sine
from servobench.systems.signals.square import Square
from servobench.systems.signals.sum import Sum


def test_the_default_is_the_papers_square_wave_on_the_twin() -> None:
    experiment = Experiment()

    assert experiment.signal == Square(low=1, high=3, frequency=0.4)
    assert (experiment.duration, experiment.sample_time, experiment.samples) == (10.0, 0.002, 5000)
    assert (experiment.device.name, experiment.controller, experiment.limits.voltage) == (
        "twin",
        OpenLoop(),
        10.0,
    )
    assert PAPER.model_copy(update={"name": "", "notes": ""}) == experiment


def test_what_has_to_be_said_in_python_is_the_signal_and_the_duration() -> None:
    assert Experiment(signal=Square(low=1, high=3, frequency=0.4), duration=10) == Experiment()


@pytest.mark.parametrize(
    ("duration", "sample_time", "expected"),
    [
        (10, 0.002, 5000),
        (0.3, 0.1, 3),  # 0.3 / 0.1 is a rounding below 3
        (0.7, 0.1, 7),  # and this one a rounding below 7
        (0.07, 0.01, 7),  # and this one a rounding above 7
        (1.0, 0.3, 4),  # at 0, 0.3, 0.6 and 0.9 s
        (86400, 0.001, 86_400_000),
        (1e9, 1e-5, 10**14),
        (0.0041, 0.002, 3),
    ],
)
def test_the_samples_are_the_ticks_before_the_end(duration: float, sample_time: float, expected: int) -> None:
    assert Experiment(duration=duration, sample_time=sample_time).samples == expected


def test_an_endless_experiment_has_no_number_of_samples() -> None:
    assert Experiment(duration=None).samples is None
    assert Experiment.model_validate({"duration": "endless"}).duration is None


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"duration": 0}, "greater than 0"),
        ({"duration": 0.002}, "a duration of 0.002 s holds fewer than two samples, 0.002 s apart"),
        ({"sample_time": 20}, "a duration of 10 s holds fewer than two samples, 20 s apart"),
        ({"sample_time": -1}, "greater than 0"),
        ({"sample_time": 1e-300}, r"greater than or equal to 0\.000000001"),
        ({"duration": 1e300}, "less than or equal to 1000000000"),
        ({"duration": float("inf")}, "finite"),
        ({"seed": -1}, "greater than or equal to 0"),
        ({"seed": 1.0}, "valid integer"),
        ({"signal": "square"}, "'square' isn't a signal"),
        ({"controller": Square()}, "isn't a controller"),
        ({"limits": {"voltage": 0}}, "greater than 0"),
        ({"device": {"name": ""}}, "at least 1 character"),
        ({"device": {"settings": {"a": None}}}, "None can't be a setting"),
        ({"device": {"settings": {"a": [float("nan")]}}}, "nan can't be a setting"),
        ({"device": {"settings": {"a": {1: 2}}}}, "can't be a setting"),
        ({"device": {"settings": {"a": ["\ud800"]}}}, "character 1 is half a surrogate pair"),
        ({"notes": "ab\ud800"}, "character 3 is half a surrogate pair"),
        ({"sample_rate": 500}, r"not known here \(did you mean 'sample_time'\?\)"),
    ],
)
def test_an_experiment_that_can_not_be_is_refused(given: dict, message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        Experiment.model_validate(given)


def test_it_can_be_sent_to_another_process() -> None:
    experiment = Experiment(
        signal=Sum(parts=(Square(), PRBS())), device={"settings": {"resistance": "8.4 ohm"}}
    )

    assert pickle.loads(pickle.dumps(experiment)) == experiment


def test_its_device_settings_are_its_own() -> None:
    settings = {"loads": [1, 2]}
    experiment = Experiment(device={"settings": settings})

    settings["loads"].append(3)

    assert experiment.device.settings == {"loads": [1, 2]}


@pytest.mark.parametrize(
    "experiment", [PAPER, Experiment(signal=PRBS(), duration="10.2 s"), Experiment(duration=None)]
)
def test_there_is_nothing_to_say_about_a_good_experiment(experiment: Experiment) -> None:
    assert experiment.findings() == ()


@pytest.mark.promise("S12")
@pytest.mark.parametrize(
    ("experiment", "code", "said"),
    [
        (Experiment(signal=Sine(frequency=251)), "signal-too-fast", "changes within 0.00199203 s"),
        (Experiment(signal=PRBS(bit_time="1 ms")), "signal-too-fast", "changes within 0.001 s"),
        (Experiment(signal=Square(frequency=200, duty=0.1)), "signal-too-fast", "changes within 0.0005 s"),
        (Experiment(signal=Sine(amplitude=12)), "signal-above-limit", "clipped at the limit of 10 V"),
        (
            Experiment(signal=Constant(value=-2), limits=Limits(voltage=1)),
            "signal-above-limit",
            "reaches -2 V, for example at 0 s",
        ),
        (
            Experiment(signal=Ramp(final=20, duration=10), duration=None),
            "signal-above-limit",
            "reaches 20 V, for example at 10 s",
        ),
        (
            Experiment(signal=Square(low=-2, high=2), limits=Limits(slew=1500)),
            "signal-above-slew",
            "by up to 2000 V/s from one sample to the next; it is limited to 1500 V/s",
        ),
        (
            Experiment(limits=Limits(terminate=Outputs(voltage=0.5))),
            "voltage-after-fault",
            "After a fault 0.5 V stay on the motor (limits.terminate.voltage)",
        ),
        (
            Experiment(limits=Limits(start=Outputs(voltage=0.5))),
            "voltage-at-start",
            "0.5 V are applied before the run starts (limits.start.voltage)",
        ),
        (Experiment(limits=Limits(stall="off")), "stall-not-watched", "A blocked shaft isn't detected"),
        (Experiment(signal=Constant(value=0)), "signal-is-zero", "0 V from the start to 9.998 s"),
        (
            Experiment(signal=PRBS(order=10)),
            "part-of-a-period",
            "repeats after 40.92 s, but the experiment ends after 10 s",
        ),
    ],
)
def test_what_is_worth_knowing_beforehand_is_a_finding(experiment: Experiment, code: str, said: str) -> None:
    (finding,) = experiment.findings()

    assert finding.code == code
    assert said in finding.sentence


@pytest.mark.parametrize(
    "signal", [Sine(frequency=250), PRBS(bit_time="2 ms", order=4), Sine(amplitude=10, frequency=1)]
)
def test_what_is_just_within_the_limits_is_no_finding(signal: Sine) -> None:
    assert Experiment(signal=signal).findings() == ()
