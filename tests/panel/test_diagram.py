"""The diagram is true: every stage and every setting is in it, what changes in them changes in it, and its formulas hold."""

import cmath
import json
import re
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel

from servobench.core.channels import Channel, DeviceInfo
from servobench.core.errors import UsageError
from servobench.core.settings import In
from servobench.core.units import unit
from servobench.panel.diagram import Diagram, diagram
from servobench.panel.placement import Box, drawing, placement
from servobench.recordings.measurement.base import STAGES, Chain
from servobench.rig.devices.base import DEVICES, connect
from servobench.rig.experiment import PAPER, Experiment
from servobench.rig.experiment.experiment import DeviceChoice
from servobench.rig.experiment.limits import Limits, StallLimits
from servobench.systems.control.base import CONTROLLERS
from servobench.systems.control.lead import Lead
from servobench.systems.control.pid import Pid
from servobench.systems.control.state_feedback import StateFeedback
from servobench.systems.signals.base import SIGNALS
from servobench.systems.signals.sine import Sine
from servobench.systems.signals.square import Square
from servobench.systems.signals.sum import Sum
from tests.contracts.test_signals import example

TWIN = connect("twin").info
CHAIN = Chain.parse("derivative | lowpass 50 rad/s")
STAGE_TEXTS = [text for name in STAGES.names() for text in STAGES[name].examples]


def drawn(experiment: Experiment = PAPER, chain: Chain = CHAIN, info: DeviceInfo = TWIN) -> Diagram:
    return diagram(experiment, info, chain)


def settings(found: Diagram, block: str) -> dict[str, tuple[object, str]]:
    return {setting.name: (setting.value, setting.unit) for setting in found[block].settings}


def leaves(value: object, path: str = "") -> Iterator[tuple[str, object]]:
    """The leaves of a model, by the rules of pydantic's own dump: an enumeration that doesn't use the diagram."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from leaves(inner, f"{path}.{key}")
    elif isinstance(value, list | tuple) and any(isinstance(each, dict) for each in value):
        for number, inner in enumerate(value):
            yield from leaves(inner, f"{path}[{number}]")
    else:
        yield path.removeprefix("."), value


def as_shown(value: object) -> object:
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else value


@pytest.mark.parametrize("name", SIGNALS.names())
def test_every_setting_of_a_signal_is_there_with_its_value(name: str) -> None:
    signal = example(name)
    shown = settings(drawn(Experiment(signal=signal, duration=10)), "signal")

    expected = dict(leaves(signal.model_dump()))
    assert {key: value for key, (value, _) in shown.items()} == {k: as_shown(v) for k, v in expected.items()}


@pytest.mark.parametrize("name", CONTROLLERS.names())
def test_every_setting_of_a_controller_is_there_with_its_value(name: str) -> None:
    law: Any = CONTROLLERS[name]()

    shown = settings(drawn(Experiment(controller=law)), "controller")

    assert {key: value for key, (value, _) in shown.items()} == dict(leaves(law.model_dump()))


@pytest.mark.parametrize("kind", [SIGNALS, CONTROLLERS])
def test_a_setting_that_changes_changes_its_block_and_no_other(kind: Any) -> None:
    field_of = {SIGNALS: "signal", CONTROLLERS: "controller"}[kind]
    tried = 0
    for name in kind.names():
        member = example(name) if kind is SIGNALS else kind[name]()
        for key, value in member.model_dump().items():
            if not isinstance(value, float):
                continue
            other = member.model_copy(update={key: value + 0.125})
            before = drawn(Experiment(**{field_of: member}))
            after = drawn(Experiment(**{field_of: other}))
            changed = [a.id for a, b in zip(before.blocks, after.blocks, strict=True) if a != b]
            assert changed == [field_of], f"{name}.{key}"
            assert settings(after, field_of)[key][0] == value + 0.125
            tried += 1
    assert tried >= 10


@pytest.mark.parametrize("kind", [SIGNALS, CONTROLLERS])
def test_a_setting_has_the_unit_that_its_field_is_marked_with(kind: Any) -> None:
    for name in kind.names():
        member = example(name) if kind is SIGNALS else kind[name]()
        found = drawn(Experiment(**{"signal" if kind is SIGNALS else "controller": member}))
        shown = settings(found, "signal" if kind is SIGNALS else "controller")
        for key, field in type(member).model_fields.items():
            marks = [mark.si for mark in field.metadata if isinstance(mark, In)]
            if marks:
                assert shown[key][1] == marks[0], f"{name}.{key}"


def test_levels_are_in_the_unit_that_the_controller_follows() -> None:
    followed = drawn(Experiment(controller=Pid(output="speed")))

    assert settings(followed, "signal")["low"] == (1.0, "rad/s")
    assert settings(followed, "signal")["frequency"] == (0.4, "Hz")


@pytest.mark.parametrize(("output", "expected"), [("position", "V/rad"), ("speed", "V·s/rad")])
def test_a_gain_is_in_the_unit_of_what_is_followed(output: Any, expected: str) -> None:
    assert settings(drawn(Experiment(controller=Pid(output=output, kp=3))), "controller")["kp"] == (
        3.0,
        expected,
    )
    lead = drawn(Experiment(controller=Lead(output=output, gain=3)))
    assert settings(lead, "controller")["gain"] == (3.0, expected)
    feedback = StateFeedback(output=output, position_gain=0, reference_gain=3)
    assert settings(drawn(Experiment(controller=feedback)), "controller")["reference_gain"] == (3.0, expected)


def test_signals_within_a_signal_are_reported_one_by_one() -> None:
    shown = settings(drawn(Experiment(signal=Sum(parts=(Square(low=2), Sine(amplitude=0.5))))), "signal")

    assert shown["parts[0].type"] == ("square", "")
    assert shown["parts[0].low"] == (2.0, "V")
    assert shown["parts[1].type"] == ("sine", "")
    assert shown["parts[1].amplitude"] == (0.5, "V")


def test_every_setting_of_an_experiment_is_in_some_block() -> None:
    """Every setting is visible: all leaves of an experiment in which none has its default."""
    asked = Experiment(
        name="everything",
        notes="all of it",
        seed=7,
        nominal="qube_servo_2",
        until="time_constant=1%",
        chain="derivative",
        limits=Limits(slew=50, speed=300, stall=StallLimits(duration=2)),
        device=DeviceChoice(
            settings={"coulomb_torque": 1e-3, "nested": {"depth": 3}},
            faults=({"name": "stuck_channel", "from": "2 s"}, {"name": "repeated"}),
        ),
    )
    found = drawn(asked)
    shown = [(setting.name, setting.value) for block in found.blocks for setting in block.settings]

    for path, value in leaves(asked.model_dump()):
        if path in {"signal.type", "controller.type"}:
            kind = path.partition(".")[0]
            assert found[kind].title == str(value).replace("_", " ")
            continue
        name = path
        for prefix in ("signal.", "controller.", "limits.", "device."):
            name = name.removeprefix(prefix)
        assert (name, as_shown(value)) in shown, path


def test_of_limits_every_number_is_shown_and_the_title_is_the_voltage() -> None:
    found = drawn(Experiment(limits=Limits(voltage=6)))

    assert found["limits"].title == "±6 V"
    assert settings(found, "limits")["voltage"] == (6.0, "V")
    assert settings(found, "limits")["stall.duration"] == (3.0, "s")
    assert settings(found, "limits")["stall.motion"] == (1.0, "rad/s")


@pytest.mark.parametrize("text", STAGE_TEXTS)
def test_every_stage_is_a_block_with_its_settings(text: str) -> None:
    stage = Chain.parse(text).stages[0]

    shown = settings(drawn(chain=Chain.parse(text)), "stage1")

    assert shown["text"][0] == str(stage)
    numbers = {value for value, _ in shown.values() if isinstance(value, float)}
    fields = vars(stage)
    assert {value for value in fields.values() if isinstance(value, float)} == numbers
    assert set(fields) <= set(shown)


@pytest.mark.parametrize(
    ("text", "field", "expected"),
    [
        ("lowpass 8 Hz", "cutoff", "rad/s"),
        ("average 20 ms", "window", "s"),
        ("tachometer 10 ms", "window", "s"),
        ("delay 10 ms", "time", "s"),
    ],
)
def test_a_stages_number_has_its_unit(text: str, field: str, expected: str) -> None:
    assert settings(drawn(chain=Chain.parse(text)), "stage1")[field][1] == expected


def test_stages_stand_in_the_order_in_which_the_signal_passes_them() -> None:
    chain = Chain.parse("unwrap 16 bit | scale -1 | derivative | average 20 ms | lowpass 50 rad/s")
    found = drawn(chain=chain)

    way = ["recorder"]
    following = {wire.source: wire.target for wire in found.wires if wire.target != "identification"}
    while way[-1] in following:
        way.append(following[way[-1]])
    titles = [found[block].title for block in way]
    assert titles == [
        "recorder",
        "unwrap",
        "unwrap",
        "counts to angle",
        "scale",
        "derivative",
        "average",
        "lowpass",
        "speed",
    ]


def test_an_empty_chain_leads_from_the_angle_to_the_scope() -> None:
    found = drawn(chain=Chain())

    assert ("angle", "scope") in {(wire.source, wire.target) for wire in found.wires}
    assert found["scope"].title == "position"


def _frequency_response(stage: Any, omega: float, sample_time: float) -> complex:
    """The response of a stage to a sine, in the steady state: the complex amplitude, by least squares over whole periods."""
    period = 2 * np.pi / omega
    samples = round(period / sample_time)
    t = np.arange(6 * samples) * (period / samples)
    y = stage(np.cos(omega * t), t)[-samples:]
    return complex(2 / samples * np.sum(y * np.exp(-1j * omega * t[-samples:])))


def _value(formula: str, s: complex, sample_time: float) -> complex:
    """A formula of a block, evaluated."""
    text = formula.replace("−", "-").replace("·", "*").replace("z^{-1}", "exp(-s*T)")
    text = re.sub(r"e\^\{([^}]*)\}", r"exp(\1)", text)
    return complex(eval(text, {"__builtins__": {}}, {"s": s, "exp": cmath.exp, "T": sample_time}))


@pytest.mark.parametrize("text", [text for text in STAGE_TEXTS if STAGES[text.split()[0]].linear])
def test_a_stages_formula_is_what_the_stage_does(text: str) -> None:
    stage: Any = Chain.parse(text).stages[0]
    omega, sample_time = 20.0, 1e-5
    factor = unit(stage.unit).factor if getattr(stage, "unit", None) else 1.0
    formula = [part.removesuffix(getattr(stage, "unit", None) or "") for part in stage.symbol]

    measured = _frequency_response(stage, omega, sample_time)
    parts = [_value(part, 1j * omega, sample_time) for part in formula]
    told = parts[0] / parts[1] if len(parts) == 2 else parts[0]

    # Filters are computed once a sample: what is computed and what is written differ by up to one sample's phase, ω T = 2e-4
    # (`zoh` by half of it). The cut-off of 50 rad/s adds no more than its own ω_c T = 5e-4.
    assert abs(measured / (factor * told) - 1) < 1e-3


def test_a_twins_hidden_truths_stay_hidden_unless_the_experiment_sets_them() -> None:
    asked = Experiment(device=DeviceChoice(settings={"resistance": "9 ohm"}))
    text = json.dumps(drawing(drawn(asked)))

    assert "9 ohm" in text
    for name in DEVICES["twin"].Settings.model_fields:
        if name not in {"resistance", "motor", "timing", "delay", "counter_bits", "counts_per_rev"}:
            assert f'"settings.{name}"' not in text, name


def test_the_device_is_drawn_as_it_says_it_is() -> None:
    bare = DeviceInfo(name="bare", channels=(Channel(name="counts", unit="counts"),))
    rich = connect("twin", tachometer=True, counts_per_rev=512, counter_bits=16).info

    assert {block.id for block in drawn(info=bare).blocks}.isdisjoint({"amplifier", "unwrap", "angle"})
    found = drawn(info=rich)
    assert found["encoder"].symbol == ("512", "2π")
    assert found["angle"].symbol == ("2π", "512")
    assert found["unwrap"].symbol == ("mod 2^{16}",)
    assert {"current", "tachometer"} <= {block.id for block in found.blocks}


def test_only_a_controller_that_follows_something_has_a_feedback() -> None:
    feedback = ("encoder", "controller")

    assert feedback not in {(wire.source, wire.target) for wire in drawn().wires}
    closed = drawn(Experiment(controller=Pid()))
    assert feedback in {(wire.source, wire.target) for wire in closed.wires}


def test_the_curve_is_the_signals_own() -> None:
    curve = drawn(Experiment(signal=Square(low=-2, high=2, frequency=1, duty=0.25), duration=10))[
        "signal"
    ].curve

    # A quarter of each period is high; two periods are drawn. In each an edge costs up to one of 240 steps, and the two ends
    # are rounded to four decimals.
    high = sum(b[0] - a[0] for a, b in pairwise(curve) if a[1] == b[1] == 1.0)
    assert high == pytest.approx(0.25, abs=2 / 240 + 2e-4)
    assert {y for _, y in curve} == {0.0, 1.0}


def _touching(a: Box, b: Box) -> bool:
    return a.x <= b.right and b.x <= a.right and a.y <= b.bottom and b.y <= a.bottom


def _on_the_edge(point: tuple[float, float], box: Box) -> bool:
    x, y = point
    across = box.x - 1e-9 <= x <= box.right + 1e-9
    along = box.y - 1e-9 <= y <= box.bottom + 1e-9
    return (across and min(abs(y - box.y), abs(y - box.bottom)) < 1e-9) or (
        along and min(abs(x - box.x), abs(x - box.right)) < 1e-9
    )


LAYOUTS = [
    (Experiment(controller=CONTROLLERS[name]()), Chain.parse(chain), connect("twin", tachometer=True).info)
    for name in CONTROLLERS.names()
    for chain in ("", "derivative", " | ".join(["derivative", *["lowpass 50 rad/s"] * 7]))
] + [(PAPER, CHAIN, DeviceInfo(name="bare")), (PAPER, CHAIN, TWIN)]


@pytest.mark.parametrize(("experiment", "chain", "info"), LAYOUTS)
def test_no_blocks_touch_and_wires_join_what_they_should(
    experiment: Experiment, chain: Chain, info: DeviceInfo
) -> None:
    found = drawn(experiment, chain, info)
    placed = placement(found)

    boxes = list(placed.boxes.items())
    for i, (name, box) in enumerate(boxes):
        assert box.x >= 0
        assert box.right <= placed.width
        assert box.bottom <= placed.height
        for other, another in boxes[i + 1 :]:
            assert not _touching(box, another), (name, other)
    for wire, path in zip(found.wires, placed.paths, strict=True):
        assert _on_the_edge(path.points[-1], placed.boxes[wire.target]), wire
        # One that branches off begins on another wire.
        assert path.joint or _on_the_edge(path.points[0], placed.boxes[wire.source]), wire
        corners = pairwise(path.points)
        assert all(a[0] == b[0] or a[1] == b[1] for a, b in corners), wire


def test_it_can_be_sent_and_nothing_is_lost() -> None:
    found = drawn(Experiment(controller=Pid()))
    sent = json.loads(json.dumps(drawing(found), allow_nan=False))

    assert [block["id"] for block in sent["blocks"]] == [block.id for block in found.blocks]
    assert [(wire["from"], wire["to"]) for wire in sent["wires"]] == [
        (w.source, w.target) for w in found.wires
    ]
    assert {"name": "frequency", "value": 0.4, "unit": "Hz"}.items() <= next(
        s for b in sent["blocks"] if b["id"] == "signal" for s in b["settings"] if s["name"] == "frequency"
    ).items()


def test_a_block_that_is_not_there_is_refused_with_those_that_are() -> None:
    with pytest.raises(UsageError, match="no block 'gear'; it has signal, controller"):
        drawn()["gear"]


def test_members_are_models() -> None:
    """The enumeration above depends on this."""
    assert all(isinstance(example(name), BaseModel) for name in SIGNALS.names())
