"""An experiment in a file: what is read, what is written, and what is told of mistakes."""

import math
import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError

from servobench.core.errors import ExperimentError, UsageError
from servobench.core.settings import Resistance, Settings
from servobench.rig.devices.base import DEVICES
from servobench.rig.experiment import PAPER, Experiment, explain, load_experiment, read_experiment
from servobench.systems.signals.multisine import Multisine
from servobench.systems.signals.prbs import PRBS
from servobench.systems.signals.sequence import Segment, Sequence
from servobench.systems.signals.sine import Sine
from servobench.systems.signals.square import Square
from servobench.systems.signals.staircase import Staircase
from servobench.systems.signals.sum import Sum

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
SQUARE = '[signal]\ntype = "square"\n'


def told(text: str) -> list[str]:
    """Return the lines of the error that a text leads to."""
    with pytest.raises(ExperimentError) as caught:
        read_experiment(text, "my.toml")
    return str(caught.value).splitlines()


LEVELS = st.floats(-10, 0)
TIMES = st.floats(1e-3, 1e3)
PHASES = st.sampled_from(["schroeder", "random"])
SIMPLE = st.one_of(
    st.builds(
        Square,
        low=LEVELS,
        high=st.floats(0, 10),
        frequency=TIMES,
        phase=st.floats(-7, 7),
        duty=st.floats(0, 1),
    ),
    st.builds(Staircase, levels=st.lists(LEVELS, min_size=1, max_size=4), dwell=TIMES),
    st.builds(PRBS, bit_time=TIMES, order=st.integers(8, 20), seed=st.integers(1, 255), start=TIMES),
    st.builds(Multisine, frequency=st.floats(0.1, 1), lowest=st.none() | st.floats(0.1, 1), phases=PHASES),
)
SIGNALS = st.recursive(
    SIMPLE,
    lambda inner: (
        st.builds(Sum, parts=st.lists(inner, min_size=1, max_size=3))
        | st.builds(
            Sequence,
            segments=st.lists(st.builds(Segment, duration=TIMES, signal=inner), min_size=1, max_size=3),
        )
    ),
    max_leaves=4,
)
SCALARS = st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=12)
TREES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)
EXPERIMENTS = st.builds(
    Experiment,
    name=st.text(max_size=20),
    notes=st.text(max_size=60),
    signal=SIGNALS,
    duration=st.none() | st.floats(1, 1e6),
    sample_time=st.floats(1e-6, 0.4),
    seed=st.none() | st.integers(min_value=0),
    chain=st.sampled_from(["", "derivative | lowpass 50 rad/s"]),
    device=st.fixed_dictionaries(
        {"name": st.text(min_size=1), "settings": st.dictionaries(st.text(max_size=5), TREES, max_size=3)}
    ),
    when_late=st.fixed_dictionaries(
        {"missed": st.sampled_from(["discard", "process"]), "phase": st.sampled_from(["keep", "lose"])}
    ),
    limits=st.fixed_dictionaries(
        {"voltage": st.floats(0.1, 24)},
        optional={
            "slew": st.floats(0.1, 1e6),
            "current": st.floats(0.01, 10),
            "speed": st.floats(1, 1e4),
            "travel": st.floats(0.1, 1e6),
            "possible_speed": st.floats(1, 1e4),
            "stall": st.just("off") | st.fixed_dictionaries({"duration": st.floats(0.01, 10)}),
            "plausibility": st.just("off")
            | st.fixed_dictionaries({"gain": st.floats(1, 100), "time_constant": st.floats(0.01, 1)}),
            "watchdog": st.fixed_dictionaries(
                {"timeout": st.floats(0.02, 0.5), "light": st.sampled_from(["off", "red"])}
            ),
        },
    ),
)


@given(EXPERIMENTS)
def test_an_experiment_reads_back_from_its_toml_equal(experiment: Experiment) -> None:
    assert read_experiment(experiment.to_toml()) == experiment


def test_a_written_experiment_spells_out_its_units_and_defaults() -> None:
    experiment = Experiment(
        name="two sines",
        notes='First line,\nsecond "line"\t\\ with a \x7f.\n',
        signal=Sum(parts=(Sine(), Sine(amplitude=2, frequency=3))),
        duration=None,
        seed=None,
        device={"settings": {"resistance": "8.4 ohm", "gear box": {"ratio": 70}, "wires": [1, 2.5]}},
    )

    expected = '''# An experiment for servobench. A number without a unit is in SI units.

[experiment]
name = "two sines"
notes = """
First line,
second \\"line\\"\\t\\\\ with a \\u007f.
"""
sample_time = "0.002 s"
duration = "endless"
seed = "random"

[signal]
type = "sum"

[[signal.parts]]
type = "sine"
amplitude = "1 V"
offset = "0 V"
frequency = "0.4 Hz"
phase = "0 rad"
start = "0 s"

[[signal.parts]]
type = "sine"
amplitude = "2 V"
offset = "0 V"
frequency = "3 Hz"
phase = "0 rad"
start = "0 s"

[controller]
type = "open_loop"

[device]
name = "twin"

[device.settings]
resistance = "8.4 ohm"
wires = [1, 2.5]

[device.settings."gear box"]
ratio = 70

[limits]
voltage = "10 V"
driven_light = "green"
fault_light = "red"

[limits.stall]
voltage = "5 V"
motion = "1 rad/s"
warning = "0.04 s"
duration = "3 s"

[limits.plausibility]
motor = ""
coulomb_voltage = "0.2 V"
voltage = "2 V"

[limits.start]
voltage = "0 V"
light = "blue"

[limits.terminate]
voltage = "0 V"
light = "blue"

[limits.watchdog]
voltage = "0 V"
light = "red"
timeout = "0.1 s"

[when_late]
missed = "discard"
phase = "keep"
'''
    assert experiment.to_toml() == expected
    assert read_experiment(expected) == experiment


def test_a_file_needs_a_signal_and_nothing_else() -> None:
    assert read_experiment(SQUARE) == Experiment()
    assert read_experiment("signal.type = 'square'") == Experiment()


def test_a_sample_rate_stands_for_a_sample_time() -> None:
    assert read_experiment(f'[experiment]\nsample_rate = "500 Hz"\n{SQUARE}').sample_time == 0.002
    assert told(f'[experiment]\nsample_rate = "500 Hz"\nsample_time = "2 ms"\n{SQUARE}') == [
        "my.toml:1: experiment: has both sample_time and sample_rate; leave one of them out"
    ]


def test_words_stand_for_no_end_and_for_another_seed_each_time() -> None:
    experiment = read_experiment(f'[experiment]\nduration = "endless"\nseed = "random"\n{SQUARE}')

    assert (experiment.duration, experiment.seed) == (None, None)


def test_what_is_done_when_late_is_one_of_two_words_each() -> None:
    experiment = read_experiment(f'{SQUARE}\n[when_late]\nmissed = "process"')

    assert (experiment.when_late.missed, experiment.when_late.phase) == ("process", "keep")
    assert told(f'{SQUARE}\n[when_late]\nphase = "drop"')[0].endswith(
        "when_late.phase: 'drop' should be 'keep' or 'lose'"
    )


def test_all_mistakes_are_reported_at_once_in_the_order_of_their_lines() -> None:
    text = """# An experiment with mistakes
[experiment]
duration = "10 A"
sampel_time = 3
name = 4

[signal]
type = "square"
freqency = "1 Hz"
frequency = "10 A"
duty = 3

[devise]
[limits]
voltage = "-1 V"
[device]
name = "twin"
settings = 8
"""

    assert told(text) == [
        "my.toml:3: experiment.duration: '10 A' is a current; expected something in s (for example \"1 s\")",
        "my.toml:4: experiment.sampel_time: not known here (did you mean 'sample_time'?); "
        "known: name, notes, duration, sample_time, sample_rate, seed, chain, nominal, until",
        "my.toml:5: experiment.name: 4 should be a text in quotes",
        "my.toml:9: signal.freqency: not known here (did you mean 'frequency'?); "
        "known: low, high, frequency, phase, duty, start",
        "my.toml:10: signal.frequency: '10 A' is a current; expected something in Hz (for example \"1 Hz\")",
        "my.toml:11: signal.duty: 3 should be less than or equal to 1",
        "my.toml:13: devise: not known here (did you mean 'device'?); known: experiment, controller, signal, device, limits, "
        "when_late",
        "my.toml:15: limits.voltage: '-1 V' should be greater than 0",
        "my.toml:18: device.settings: 8 should be a table",
    ]


def test_mistakes_in_nested_signals_are_reported_where_they_stand() -> None:
    text = """[signal]
type = "sum"
[[signal.parts]]
type = "square"
[[signal.parts]]
type = "prbs"
order = 99
[[signal.parts]]
type = "sum"
parts = [ {type = "sine", frequency = "1 V"}, # }
  {type = "sin"},
  "x" ]
"""

    lines = told(text)

    assert [line.rsplit(";")[0] for line in lines] == [
        "my.toml:7: signal.parts[1].order: 99 should be less than or equal to 20",
        "my.toml:10: signal.parts[2].parts[0].frequency: '1 V' is a voltage",
        "my.toml:11: signal.parts[2].parts[1].type: no signal called 'sin' (did you mean 'sine'?)",
        "my.toml:12: signal.parts[2].parts[2]: 'x' isn't a signal",
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "my.toml: signal: is missing; add a table [signal] with type = "),
        ("[experiment]\nname = 'x'", "my.toml: signal: is missing; add a table [signal] with type = "),
        ("[signal]", "my.toml:1: signal.type: is missing; expected the name of a signal; known: chirp, "),
        (
            "signal = 'square'",
            "my.toml:1: signal: 'square' isn't a signal; expected a table with a type, one of chirp, ",
        ),
        ("\nexperiment = 3\nsignal.type = 'sine'", "my.toml:2: experiment: 3 should be a table"),
        (
            "[signal]\ntype = 'sequence'\n[[signal.segments]]\nduration = 1",
            "my.toml:3: signal.segments[0].signal: is missing",
        ),
        ("[signal]\ntype = 'staircase'\nlevels = 3", "my.toml:3: signal.levels: 3 should be an array"),
        (
            "[signal]\ntype = 'staircase'\nlevels = []",
            "my.toml:3: signal.levels: is empty; expected one at least",
        ),
        (
            "[signal]\ntype = 'prbs'\nseed = 256",
            "my.toml:1: signal: seed = 256 doesn't fit a register of 8 bits",
        ),
        ("[signal]\ntype = 'square'\nlow = 5", "my.toml:1: signal.high: high = 3 is below low = 5"),
        (
            "[signal]\ntype = 'sine'\n[controller]\ntype = 'pdi'",
            "my.toml:4: controller.type: no controller called 'pdi'",
        ),
        (
            f"[experiment]\nduration = '1 ms'\n{SQUARE}",
            "my.toml:1: experiment: a duration of 0.001 s holds fewer than two",
        ),
        (
            f"{SQUARE}[device.settings]\nfrom = 1979-05-27",
            "my.toml:3: device.settings: datetime.date(1979, 5, 27) can't be",
        ),
        (
            f"[experiment]\nnotes = {'[' + '1,' * 99 + ']'}\n{SQUARE}",
            f"my.toml:2: experiment.notes: [{'1, ' * 18}1,... should",
        ),
        ("a = 1\nb = \n", "my.toml:2: this isn't TOML: Invalid value (column 5)"),
        ("a = 1\na = 2", "my.toml:2: this isn't TOML: Cannot overwrite a value (end of the file)"),
        ('a = """\n', "my.toml:2: this isn't TOML: Unterminated string (end of the file)"),
        ("x = " + "[" * 5000, "my.toml: its arrays or tables are nested too deeply"),
        ("x = " + "9" * 6000, "my.toml: this can't be read as TOML: Exceeds the limit"),
    ],
)
def test_a_mistake_is_reported_with_its_line(text: str, expected: str) -> None:
    (line,) = told(text)
    assert line.startswith(expected)


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"", ": signal: is missing"),
        (b'# first\nname = "\xe9"', ":2: this isn't UTF-8; save the file as UTF-8"),
        (
            'name = "x"'.encode("utf-16"),
            ":1: this isn't UTF-8 (it looks like UTF-16); save the file as UTF-8",
        ),
        (
            b"\xef\xbb\xbf[signal]\r\ntype = 'step'\r\nfinal = 'x'\r\n",
            ":3: signal.final: 'x' isn't a number with a unit",
        ),
    ],
)
def test_a_file_that_can_not_be_used_is_named(tmp_path: Path, data: bytes, expected: str) -> None:
    path = tmp_path / "my.toml"
    path.write_bytes(data)

    with pytest.raises(ExperimentError) as caught:
        load_experiment(path)
    assert str(caught.value).startswith(f"{path}{expected}")


def test_what_is_no_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ExperimentError, match=r"none\.toml: no such file"):
        load_experiment(tmp_path / "none.toml")
    with pytest.raises(
        ExperimentError, match=r"is a directory; expected a TOML file|can't be read"
    ):  # Windows says the latter
        load_experiment(tmp_path)
    with pytest.raises(ExperimentError, match="can't be read"):
        load_experiment("a\0b")


def test_an_error_of_another_layer_is_reported_with_the_line_in_the_file() -> None:
    class Motor(Settings):
        resistance: Resistance = 8.4

    text = f'{SQUARE}[device]\nname = "moter"\nsettings.resistance = "8.4 V"\nsettings.resistence = 1\n'
    experiment = read_experiment(text)

    with pytest.raises(ValidationError) as refused:
        Motor.model_validate(experiment.device.settings)
    assert str(explain(refused.value, text, "my.toml", ("device", "settings"))).splitlines() == [
        "my.toml:5: device.settings.resistance: '8.4 V' is a voltage; expected something in ohm (for example \"1 ohm\")",
        "my.toml:6: device.settings.resistence: not known here (did you mean 'resistance'?); known: resistance",
    ]
    unknown = UsageError("no device called 'moter'")
    assert (
        str(explain(unknown, text, "my.toml", ("device", "name")))
        == "my.toml:4: device.name: no device called 'moter'"
    )


def test_an_error_in_a_model_that_is_not_ours_is_reported_too() -> None:
    class Foreign(BaseModel):
        port: int

    with pytest.raises(ValidationError) as refused:
        Foreign.model_validate({"port": "COM3"})
    said = str(explain(refused.value, "[device.settings]\nport = 'COM3'", "my.toml", ("device", "settings")))
    assert said.startswith("my.toml:2: device.settings.port: 'COM3' should be a valid integer")


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.stem)
def test_an_example_loads_and_its_device_takes_its_settings(path: Path) -> None:
    experiment = load_experiment(path)

    assert experiment.findings() == ()
    DEVICES[experiment.device.name].Settings(**experiment.device.settings)


def test_the_examples_are_the_papers_experiment_and_a_prbs() -> None:
    paper, prbs = load_experiment(EXAMPLES / "paper.toml"), load_experiment(EXAMPLES / "prbs.toml")

    assert paper.signal == PAPER.signal
    assert (paper.duration, paper.sample_time, paper.limits) == (
        PAPER.duration,
        PAPER.sample_time,
        PAPER.limits,
    )
    assert prbs.signal == PRBS(low=-3, high=3, order=8, bit_time=0.04)
    assert prbs.duration == pytest.approx(prbs.signal.period, rel=1e-12)
    assert "notes" in tomllib.loads((EXAMPLES / "paper.toml").read_text(encoding="utf-8"))["experiment"]


FOLLOWED = """
[signal]
type = "sum"
parts = [{{ type = "square", low = {low}, high = "180 deg" }}, {{ type = "constant", value = 1 }}]

[controller]
type = "pid"
"""


def test_what_is_followed_has_the_unit_of_the_controller_and_is_written_in_it() -> None:
    asked = read_experiment(FOLLOWED.format(low="'-0.5 rev'"))

    square = asked.signal.parts[0]  # type: ignore[attr-defined]
    assert (square.low, square.high) == (pytest.approx(-math.pi), pytest.approx(math.pi))
    assert f'"{math.pi!r} rad"' in asked.to_toml()
    assert read_experiment(asked.to_toml()) == asked


def test_volts_are_refused_where_a_position_is_followed() -> None:
    with pytest.raises(
        ExperimentError, match=r"my.toml:4: signal.parts\[0\].low: .*expected something in rad"
    ):
        read_experiment(FOLLOWED.format(low="'-1 V'"), "my.toml")
