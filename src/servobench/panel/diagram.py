"""The block diagram of an experiment: drawn from the experiment, the device and the chain."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import Field, dataclass, fields, is_dataclass
from itertools import pairwise, takewhile
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from pydantic import BaseModel

from servobench.core.channels import Channel, DeviceInfo
from servobench.core.errors import UsageError
from servobench.core.parameter_names import plain_words
from servobench.core.registry import Registry
from servobench.core.rounding import plain
from servobench.core.settings import unit_of
from servobench.core.units import unit as unit_named
from servobench.recordings.measurement.base import STAGES, Chain, Stage
from servobench.recordings.measurement.unwrap import Unwrap
from servobench.rig.experiment import Experiment
from servobench.systems.control.base import CONTROLLERS
from servobench.systems.signals.base import SIGNALS, Signal

Value: TypeAlias = float | int | bool | str | None
Curve: TypeAlias = tuple[tuple[float, float], ...]
_POINTS = 241  # of a signal's curve, which is a few millimetres wide
_SHOWN = 10.0  # seconds of a signal that neither repeats nor ends


@runtime_checkable
class Symbolic(Protocol):
    """An optional method of a member of a kind: how a block shows it.

    One text, or a numerator and a denominator; what stands in `^{}` is raised, in `_{}` lowered.
    """

    @property
    def symbol(self) -> tuple[str, ...]:
        """The text, or numerator and denominator."""
        ...


@dataclass(frozen=True, kw_only=True)
class Setting:
    """One setting of a block: its name, its value as it is (None where it isn't set), unit, and meaning in a sentence."""

    name: str
    value: Value
    unit: str = ""
    sentence: str = ""


@dataclass(frozen=True, kw_only=True)
class Block:
    """One block with its settings: `id` names it in this diagram, `kind` says what it is (`signal`, `stage`), `title` which one.

    `symbol` is its transfer function (see `Symbolic`) or empty, `curve` its course as points (x, y) in 0 to 1, upwards.
    """

    id: str
    kind: str
    title: str
    symbol: tuple[str, ...] = ()
    curve: Curve = ()
    settings: tuple[Setting, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Wire:
    """A wire from one block, the source, to another, the target, by their ids; `label` names it."""

    source: str
    target: str
    label: str = ""


@dataclass(frozen=True, kw_only=True)
class Diagram:
    """Blocks in the order of the signal, and the wires between them; `device` titles those that are the device."""

    blocks: tuple[Block, ...]
    wires: tuple[Wire, ...]
    device: str

    def __getitem__(self, name: str) -> Block:
        """Return the block of that id; raises `UsageError`."""
        for block in self.blocks:
            if block.id == name:
                return block
        raise UsageError(
            f"the diagram has no block {name!r}; it has {', '.join(block.id for block in self.blocks)}"
        )


def diagram(experiment: Experiment, info: DeviceInfo, chain: Chain) -> Diagram:
    """Return the block diagram of an experiment on a device, looked at through a measurement chain.

    Every setting of the experiment stands in one of the blocks, and every stage of the chain is one. Of the device there is what
    it says of itself: a simulated one keeps its truths hidden, but for those that the experiment sets.
    """
    device, sensors = _device(experiment, info)
    drive = (_signal(experiment), _controller(experiment), _limits(experiment))
    recorder = _recorder(experiment, info)
    stages = tuple(_stages(info, chain))
    scope, identification = _scope(chain), _identification(experiment, chain)
    beside = [block for block in sensors if block not in device]
    read_from = sensors or device[-1:]
    wires = [
        *_in_a_row((*drive, *device), _labels(experiment)),
        *(Wire(source="motor", target=block.id) for block in beside),
        *(Wire(source=block.id, target="recorder", label=_read(block)) for block in read_from),
        Wire(source="limits", target="recorder", label="voltage"),
        *_in_a_row((recorder, *stages, scope), {}),
        Wire(source=(recorder, *stages)[-1].id, target="identification", label="y"),
        Wire(source="recorder", target="identification", label="u"),
    ]
    if experiment.controller.reference_unit != "V":
        wires.append(Wire(source=device[-1].id, target="controller", label="y"))
    return Diagram(
        blocks=(*drive, *device, *beside, recorder, *stages, scope, identification),
        wires=tuple(wires),
        device=experiment.device.name,
    )


def settings_of(
    settings: BaseModel, units: Mapping[str, str] | None = None, prefix: str = ""
) -> Iterator[Setting]:
    """Yield all settings of a model, those of the models within it too, with names such as `stall.voltage` and `parts[0].low`.

    `units` has other units for those of the fields: {"V": "rad"} for the levels of a signal that a position follows.
    """
    other = units or {}
    for name, field in type(settings).model_fields.items():
        unit, value = unit_of(field, settings), getattr(settings, name)
        sentence = (field.description or "").removesuffix(f" [{unit}].").removesuffix(".").replace("`", "")
        for path, inner in _members(f"{prefix}{name}", value):
            if isinstance(inner, BaseModel):
                known = _name_in(SIGNALS, inner)
                if known:
                    yield Setting(name=f"{path}.type", value=known)
                yield from settings_of(inner, other, f"{path}.")
            else:
                yield Setting(name=path, value=_plain(inner), unit=other.get(unit, unit), sentence=sentence)


def _members(path: str, value: object) -> Iterator[tuple[str, object]]:
    """A value by its path, and one by one what it holds, where that is more than numbers and texts."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _members(f"{path}.{key}", inner)
    elif isinstance(value, list | tuple) and any(isinstance(v, BaseModel | Mapping) for v in value):
        for number, inner in enumerate(value):
            yield from _members(f"{path}[{number}]", inner)
    else:
        yield path, value


def _plain(value: object) -> Value:
    """A value as JSON has it; several of them as one text."""
    if isinstance(value, float) and not math.isfinite(value):
        return plain(value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, list | tuple):
        return ", ".join(str(_plain(each)) for each in value)
    return str(value)


def _name_in(registry: Registry[Any], member: object) -> str:
    """The name of a member, empty where it is none."""
    try:
        return registry.name_of(member)
    except UsageError:
        return ""


def _symbol(member: object) -> tuple[str, ...]:
    return tuple(member.symbol) if isinstance(member, Symbolic) else ()


def _signal(experiment: Experiment) -> Block:
    units = {"V": experiment.controller.reference_unit}
    return Block(
        id="signal",
        kind="signal",
        title=plain_words(SIGNALS.name_of(experiment.signal)),
        curve=_curve(experiment.signal, experiment.duration),
        settings=tuple(settings_of(experiment.signal, units)),  # type: ignore[arg-type]
    )


def _curve(signal: Signal, duration: float | None) -> Curve:
    """The course of a signal: two periods, or what there is of it in the experiment."""
    end = _SHOWN if duration is None else duration
    if signal.period is not None:
        end = min(end, 2 * signal.period)
    t = np.linspace(0.0, end, _POINTS)
    x = np.asarray(signal(t), dtype=np.float64)
    span = float(np.ptp(x))
    y = (x - x.min()) / span if span > 0 else np.full(len(x), 0.5)
    # Where it stays as it is the two ends are enough.
    turns = np.ones(len(y), dtype=bool)
    turns[1:-1] = (np.diff(y)[:-1] != 0) | (np.diff(y)[1:] != 0)
    return tuple(
        (round(float(a), 4), round(float(b), 4)) for a, b in zip(t[turns] / end, y[turns], strict=True)
    )


def _controller(experiment: Experiment) -> Block:
    law = experiment.controller
    return Block(
        id="controller",
        kind="controller",
        title=plain_words(CONTROLLERS.name_of(law)),
        symbol=_symbol(law),
        settings=tuple(settings_of(law)),  # type: ignore[arg-type]
    )


def _limits(experiment: Experiment) -> Block:
    limits = experiment.limits
    return Block(
        id="limits",
        kind="limits",
        title=f"±{plain(limits.voltage)} V",
        curve=((0.0, 0.1), (0.25, 0.1), (0.75, 0.9), (1.0, 0.9)),
        settings=tuple(settings_of(limits)),
    )


def _device(experiment: Experiment, info: DeviceInfo) -> tuple[list[Block], list[Block]]:
    """The blocks of the device in a row, and those of them that its samples come from."""
    motor = Block(
        id="motor",
        kind="motor",
        title="motor",
        symbol=("K", "s (τs + 1)"),
        settings=tuple(_device_settings(experiment, info)),
    )
    channels = {channel.name: channel for channel in info.channels}
    voltage = channels.pop("voltage", None)
    row = [motor]
    if voltage is not None:
        row.insert(0, _amplifier(voltage))
    sensors = [_sensor(channel) for channel in channels.values()]
    row += [block for block in sensors if block.id == "encoder"]
    return row, sensors


def _device_settings(experiment: Experiment, info: DeviceInfo) -> Iterator[Setting]:
    """The device by the experiment's settings and by its own description."""
    yield Setting(name="name", value=experiment.device.name, sentence="Name of the device")
    yield Setting(name="serial", value=info.serial, sentence="Serial number")
    yield Setting(name="timing", value=info.timing, sentence="What keeps the time")
    yield Setting(
        name="delay", value=info.delay, unit="s", sentence="Time from a write to its effect on the motor"
    )
    asked = dict(_members("settings", experiment.device.settings))
    asked.pop("settings", None)
    for name, value in asked.items():
        yield Setting(name=name, value=_plain(value), sentence="A setting of the device")
    for name, text in info.settings:
        if f"settings.{name}" not in asked:
            yield Setting(name=f"settings.{name}", value=text, sentence="A setting of the device")
    for path, value in _members("faults", [dict(fault) for fault in experiment.device.faults]):
        if value != []:
            yield Setting(name=path, value=_plain(value), sentence="A fault injected on purpose")


def _amplifier(channel: Channel) -> Block:
    low, high = channel.minimum, channel.maximum
    bounded = low is not None and high is not None and math.isfinite(low) and math.isfinite(high)
    curve: Curve = ((0.0, 0.1), (0.25, 0.1), (0.75, 0.9), (1.0, 0.9)) if bounded else ((0.0, 0.0), (1.0, 1.0))
    return Block(
        id="amplifier",
        kind="device",
        title="amplifier",
        curve=curve,
        settings=tuple(_channel_settings(channel)),
    )


def _sensor(channel: Channel) -> Block:
    """The block that a measured channel comes from."""
    encoder = channel.name == "counts"
    per_rev = channel.counts_per_rev
    return Block(
        id="encoder" if encoder else channel.name,
        kind="sensor",
        title="encoder"
        if encoder
        else f"{plain_words(channel.name)} sensor".replace("tachometer sensor", "tachometer"),
        symbol=(plain(per_rev, 7), "2π") if encoder and per_rev else (),
        curve=() if encoder and per_rev else ((0.0, 0.0), (1.0, 1.0)),
        settings=tuple(_channel_settings(channel)),
    )


def _channel_settings(channel: Channel) -> Iterator[Setting]:
    """A channel by the device's description, as far as it has one."""
    unit = channel.unit or ""
    meaning = (
        ("minimum", channel.minimum, unit, "Smallest value"),
        ("maximum", channel.maximum, unit, "Largest value"),
        ("resolution", channel.resolution, unit, "Smallest step"),
        ("counts_per_rev", channel.counts_per_rev, "counts/rev", "Counts per turn of the shaft"),
        ("counter_bits", channel.counter_bits, "bit", "Width of the counter, at which it wraps"),
    )
    yield Setting(name="channel", value=channel.name, sentence="Name of the channel in a recording")
    for name, value, of, sentence in meaning:
        if value is not None:
            yield Setting(name=name, value=_plain(value), unit=of, sentence=sentence)


_OF_THE_RECORDER = ("name", "notes", "duration", "sample_time", "seed", "when_late")


def _recorder(experiment: Experiment, info: DeviceInfo) -> Block:
    channels = ", ".join(channel.name for channel in info.channels)
    every = plain(1e3 * experiment.sample_time)
    return Block(
        id="recorder",
        kind="recorder",
        title="recorder",
        symbol=(f"T = {every} ms",),
        settings=(
            *_pick(experiment, _OF_THE_RECORDER),
            Setting(name="channels", value=channels, sentence="What is recorded"),
        ),
    )


def _pick(experiment: Experiment, names: Sequence[str]) -> tuple[Setting, ...]:
    """The experiment's settings of those names, with what is inside of them."""
    return tuple(s for s in settings_of(experiment) if s.name.partition(".")[0] in names)


def _stages(info: DeviceInfo, chain: Chain) -> Iterator[Block]:
    """The processing of the counts: for the counter's range, and the stages of the chain."""
    counts = info.channel("counts")
    stages = [_stage(f"stage{number}", each, "chain") for number, each in enumerate(chain.stages, start=1)]
    if counts is not None and counts.counter_bits is not None:
        own = Unwrap.parse((str(counts.counter_bits), "bit"))
        yield _stage("unwrap", own, "counter_bits")
    at_front = len(list(takewhile(_acts_on_counts, chain.stages)))
    yield from stages[:at_front]
    if counts is not None and counts.counts_per_rev:
        yield _angle(counts.counts_per_rev)
    yield from stages[at_front:]


def _angle(counts_per_rev: float) -> Block:
    meaning = "Counts per turn of the shaft"
    turn = Setting(name="counts_per_rev", value=_plain(counts_per_rev), unit="counts/rev", sentence=meaning)
    step = Setting(
        name="resolution",
        value=2 * math.pi / counts_per_rev,
        unit="rad/count",
        sentence="The angle of one count",
    )
    symbol = ("2π", plain(counts_per_rev, 7))
    return Block(id="angle", kind="conversion", title="counts to angle", symbol=symbol, settings=(turn, step))


def _acts_on_counts(stage: Stage) -> bool:
    """Whether a stage at the front takes counts, as they come (see `measure`)."""
    return isinstance(stage, Unwrap) and unit_named(stage.unit).si == "counts"


def _stage(name: str, stage: Stage, origin: str) -> Block:
    """A stage of measurement; its settings are its fields."""
    declared: tuple[Field[Any], ...] = fields(stage) if is_dataclass(stage) else ()
    settings = [
        Setting(
            name=field.name, value=_plain(getattr(stage, field.name)), unit=field.metadata.get("unit", "")
        )
        for field in declared
    ]
    text = Setting(name="text", value=str(stage), sentence="As written in a chain")
    linear = Setting(
        name="linear",
        value=stage.linear,
        sentence="Whether the identified model's prediction passes through it",
    )
    setting = Setting(
        name="asked_for_by", value=origin, sentence="Why it is there: the chain, or the width of the counter"
    )
    return Block(
        id=name,
        kind="stage",
        title=plain_words(STAGES.name_of(stage)),
        symbol=_symbol(stage),
        settings=(*settings, text, linear, setting),
    )


def _scope(chain: Chain) -> Block:
    """The block at the end of the chain: the scope."""
    what = "speed" if chain.takes == "speed" else chain.yields("position")
    symbol, unit = {"speed": ("ω(t)", "rad/s"), "position": ("θ(t)", "rad")}[what]
    shown = Setting(name="shows", value=what, unit=unit)
    text = Setting(name="chain", value=str(chain), sentence="The stages between the counts and the display")
    return Block(id="scope", kind="scope", title=what, symbol=(symbol,), settings=(shown, text))


def _identification(experiment: Experiment, chain: Chain) -> Block:
    """The identification, through the same chain."""
    prediction = "The stages that the model's prediction passes through, so that their lag isn't attributed to the motor"
    return Block(
        id="identification",
        kind="identification",
        title="model",
        symbol=("K, τ",),
        settings=(
            *_pick(experiment, ("nominal", "until", "chain")),
            Setting(name="prediction", value=str(chain.linear), sentence=prediction),
        ),
    )


def _in_a_row(blocks: Sequence[Block], labels: Mapping[str, str]) -> list[Wire]:
    """Wires from each block to the next; labels by the id of the first."""
    return [Wire(source=a.id, target=b.id, label=labels.get(a.id, "")) for a, b in pairwise(blocks)]


def _labels(experiment: Experiment) -> dict[str, str]:
    unit = experiment.controller.reference_unit
    return {
        "signal": "u" if unit == "V" else "r",
        "controller": "u",
        "limits": "u",
        "amplifier": "v",
        "motor": "θ",
    }


def _read(block: Block) -> str:
    """The readings of a device block."""
    return {"encoder": "counts"}.get(block.id, block.title.removesuffix(" sensor"))
