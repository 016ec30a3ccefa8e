"""The verb `measure`: from a recording to a dataset."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import takewhile
from typing import get_args

import numpy as np

from servobench.core.arguments import check_type
from servobench.core.channels import Array, Channel
from servobench.core.errors import MissingInformation, NotIdentifiable, UsageError
from servobench.core.finding import Finding, info, warning
from servobench.core.numbers import check_positive
from servobench.core.units import in_symbols, is_unit, quantity
from servobench.core.units import unit as unit_named
from servobench.recordings.measurement.accumulate import Accumulate, accumulate_counts
from servobench.recordings.measurement.armature import armature_current
from servobench.recordings.measurement.base import Chain, Kind, Stage
from servobench.recordings.measurement.column import (
    Column,
    counter_column,
    finite_column,
    input_and_output,
    si_factor,
)
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.fresh_samples import drop_repeats
from servobench.recordings.measurement.grid import grid_step, last_decimal, steps_behind_decimals
from servobench.recordings.measurement.point_of_thousands import are_thousands
from servobench.recordings.measurement.scale import Scale
from servobench.recordings.measurement.tachometer import Tachometer
from servobench.recordings.measurement.tick_times import host_delay, latch_times, write_times
from servobench.recordings.measurement.unknown_input import without_unknown_input
from servobench.recordings.measurement.unwrap import Unwrap
from servobench.recordings.measurement.wraps import suspect_wraps, without_wraps
from servobench.recordings.recording import Recording


def measure(recording: Recording, chain: Chain | str | None = None, starts_at_rest: bool = False) -> Dataset:
    """Return a recording's input and output as identification data.

    The output channel becomes a position or a speed in SI units: counts are unwrapped if the counter's width
    is known, moved to the middle of their bins, and converted to rad if the counts per revolution are known.
    Then the stages of `chain` are applied (a text such as `derivative | lowpass 50 rad/s`, or none). The
    recording's own `chain` was applied before it was written, and isn't applied again. A prediction goes
    through both.

    Stages act on SI units or counts. `accumulate`, and `unwrap` with a modulus in counts, at the front act before counts
    become rad.
    A `scale` with a unit (`scale 0.17578125 deg/count`) is a conversion: the dataset is in the new unit, and so are predictions.
    If the loop recorded when each write returned (the channel `written`), the input begins to hold at that
    time, and the output's times are the device's own latch times (`latched`). A channel recognised as the
    armature's current is included as `current`, at the times of the output. If an output is updated less
    often than it is logged, only the new samples are kept. If a record begins in mid-motion and the input
    before it isn't known, the output begins a few samples later than the input: the first samples respond to
    an input that isn't in the file. `starts_at_rest` says that the shaft is at rest when the record begins,
    and that the input was zero until then, if the recording doesn't say so itself. Findings report what is
    left out or looks wrong; rows are those of the channel, counted from 1.

    Raises `MissingInformation` if roles, units or times aren't known; `UsageError` if times don't increase,
    the output is neither a position nor a speed, or a stage can't act on it; `NotIdentifiable` for fewer than
    two samples of the output.

    >>> import servobench as sb
    >>> with sb.connect("twin") as motor:
    ...     recording = sb.run(sb.Experiment(duration="3 s"), motor)
    >>> sb.measure(recording).output_unit
    'rad'
    """
    check_type("recording", recording, Recording, "a Recording, such as load() and run() give")
    starts_at_rest = starts_at_rest or recording.starts_at_rest
    applied = Chain.parse(chain) if isinstance(chain, str) else chain or Chain()
    declared = Chain.parse(recording.chain)
    input_series, output_series = input_and_output(recording)
    driven, input_findings = finite_column(recording, input_series, "input")
    read, read_findings = drop_repeats(*finite_column(recording, output_series, "output"))
    kind = _shaft_kind(recording, read)
    _check_chains(recording, read, kind, declared, applied)
    scheduled, latched = read.t, latch_times(recording, read.t)
    if latched is not None:
        read = replace(read, t=latched)
    finished, findings = _output(read.in_si(), output_series.channel, declared, applied)
    current, current_findings = armature_current(recording, np.interp(finished.t, read.t, scheduled))
    taken = write_times(recording, driven.t)
    data = Dataset(
        name=recording.name,
        t_input=driven.t if taken is None else taken,
        u=driven.in_si().x,
        input_unit=driven.in_si().unit,
        input_before=0.0 if starts_at_rest else _input_before(recording, driven),
        starts_at_rest=starts_at_rest,
        user_unit=_user_unit(output_series.channel, finished.unit),
        recorded_unit=in_symbols(read.unit),
        t_output=finished.t,
        y=finished.x,
        output_unit=finished.unit,
        kind=applied.yields(kind),
        source=recording.source,
        quantum=finished.quantum,
        declared=_without_conversions(declared),
        applied=_without_conversions(applied),
        delay=recording.info.delay if recording.info else 0.0,
        hidden_delay=host_delay(recording, driven.t),
        current=current,
        rows=finished.rows,
        findings=(*recording.findings, *input_findings, *read_findings, *findings, *current_findings),
        reference=_reference(recording, driven.t),
        reference_unit=_reference_unit(recording),
        chain_known=bool(recording.chain.strip()) or bool(applied),
    )
    known = starts_at_rest or recording.input_before is not None
    return data if known else without_unknown_input(data)


def _reference(recording: Recording, t: Array) -> Array | None:
    """A loop's reference at the times t (N,) [s], in SI units: the value before, or the first one."""
    if recording.reference is None:
        return None
    series = recording[recording.reference]
    if series.t is None or series.channel.unit is None:
        raise MissingInformation(
            recording.name,
            [f"the times and the unit of the reference {recording.reference!r}: say `reference=COL:UNIT`"],
        )
    usable = np.isfinite(series.t) & np.isfinite(series.values)
    if not usable.any():
        raise UsageError(f"{recording.name}: the reference {recording.reference!r} has no finite value")
    order = np.argsort(series.t[usable], kind="stable")
    known, values = series.t[usable][order], series.values[usable][order]
    at = np.maximum(np.searchsorted(known, t, side="right") - 1, 0)
    return np.asarray(values[at] * unit_named(series.channel.unit).factor, dtype=np.float64)


def _reference_unit(recording: Recording) -> str | None:
    """The SI unit of a loop's reference."""
    unit = recording[recording.reference].channel.unit if recording.reference is not None else None
    return None if unit is None else unit_named(unit).si


def _user_unit(channel: Channel, si: str) -> tuple[str, float] | None:
    """The unit of position in a channel, as `Dataset.user_unit`, where the output is in `si`."""
    si, own = si.removesuffix("/s"), (channel.unit or "").removesuffix("/s")
    if channel.travel_per_rev is not None and si == "rad":
        symbol = channel.travel_per_rev.partition(" ")[2]
        return symbol, quantity(channel.travel_per_rev, "m") / unit_named(symbol).factor / (2 * math.pi)
    if not is_unit(own) or unit_named(own).si != si:
        return None
    return in_symbols(own), 1.0 / unit_named(own).factor


def _input_before(recording: Recording, column: Column) -> float:
    """The input before the first sample in SI units: what the recording says, or else the first value."""
    if recording.input_before is None:
        return float(column.in_si().x[0])
    return recording.input_before * si_factor(column.unit)[0]


def _shaft_kind(recording: Recording, column: Column) -> Kind:
    """Whether the output is a position or a speed; raises if it is neither, or has a single sample."""
    kinds: tuple[Kind, ...] = get_args(Kind)
    for kind in kinds:
        if column.quantity == kind:
            if len(column.t) < 2:
                raise NotIdentifiable(
                    f"{recording.name}: the output {column.name!r} has a single sample; expected at least two"
                )
            return kind
    raise UsageError(
        f"{recording.name}: the output {column.name!r} is in {column.unit}; expected the unit of a position (rad, deg, rev, "
        "counts, m) or of a speed (rad/s, deg/s, rpm, rev/s, counts/s, m/s): name another channel, or its right unit"
    )


def _check_chains(recording: Recording, column: Column, kind: Kind, declared: Chain, applied: Chain) -> None:
    """Raise where the output can't have come out of its declared chain, or can't go into the applied one."""
    what = f"{recording.name}: the output {column.name!r} is a {kind} ({column.unit})"
    if kind not in _all_yields(declared):
        other = "speed" if kind == "position" else "position"
        raise UsageError(
            f"{what}, but `{declared}`, its declared chain, gives a {other}: one of the two is wrong"
        )
    try:
        applied.yields(kind)
    except UsageError as error:
        raise UsageError(
            f"{what}, so `{applied}` can't be applied to it: {error}. If it was recorded after that chain, declare "
            "it as the recording's own chain"
        ) from None


def _all_yields(chain: Chain) -> set[Kind]:
    """The kinds of output that a chain can have."""
    kinds: tuple[Kind, ...] = get_args(Kind) if chain.takes is None else (chain.takes,)
    return {chain.yields(kind) for kind in kinds}


def _output(
    column: Column, channel: Channel, declared: Chain, applied: Chain
) -> tuple[Column, list[Finding]]:
    """Return the output, given in SI units or counts, as it stands in the dataset, and what was found on the way."""
    if channel.counts_per_rev is not None:
        check_positive(f"the encoder of {column.name!r}", channel.counts_per_rev, "counts/rev")
    automatic, at_front = _counter_stages(column, channel, applied)
    findings = _findings(column, declared, applied)
    if column.quantity == "position" and not any(
        isinstance(s, Unwrap | Accumulate) for s in (*automatic, *applied.stages)
    ):
        findings += suspect_wraps(column, channel.counts_per_rev)
    column, doubts = _through(column, (*automatic, *at_front))
    if column.unit in {"counts", "counts/s"}:
        findings += [] if declared.linear else _fractions(column)
        column = counter_column(column, channel)
    elif column.quantity == "position" and all(
        isinstance(s, Unwrap | Scale) for s in (declared + applied).stages
    ):
        column, quantum_findings = _with_quantum(column, channel)
        findings += quantum_findings
    if declared.linear:
        column = replace(column, quantum=None)
    column, later_doubts = _through(column, applied.stages[len(at_front) :])
    return column, [*findings, *doubts, *later_doubts]


def _counter_stages(
    column: Column, channel: Channel, applied: Chain
) -> tuple[tuple[Unwrap, ...], tuple[Stage, ...]]:
    """Return the stages that act on counts before they become rad: what the counter's width asks for, and those of the chain."""
    if column.unit != "counts":
        return (), ()
    automatic: tuple[Unwrap, ...] = ()
    if channel.counter_bits is not None:
        automatic = (Unwrap.parse((str(channel.counter_bits), "bit")),)
    return automatic, tuple(takewhile(_acts_on_counts, applied.stages))


def _acts_on_counts(stage: Stage) -> bool:
    """Whether a stage takes counts to counts, before they become an angle."""
    return isinstance(stage, Accumulate) or (
        isinstance(stage, Unwrap) and unit_named(stage.unit).si == "counts"
    )


def _with_quantum(column: Column, channel: Channel) -> tuple[Column, list[Finding]]:
    """Return a position in SI units with its smallest step: what the channel says, or else the grid that its values lie on."""
    if channel.resolution is not None and channel.unit is not None:
        return replace(column, quantum=channel.resolution * si_factor(channel.unit)[0]), []
    counts = _steps_in_a_turn(column, channel)
    if counts is not None:
        sensor = 2.0 * np.pi / counts
        sentence = (
            f"All values of {column.name!r} are angles of a sensor with {counts} steps in a turn, rounded when written; the "
            "steps are used as they were before."
        )
        column = replace(column, x=sensor * np.rint(column.x / sensor), quantum=sensor)
        return column, [info("quantum-found", sentence)]
    step = grid_step(column.x)
    if step is None:
        return column, []
    turn = f" ({2.0 * np.pi / step:.6g} in a turn)" if column.unit == "rad" else ""
    sentence = (
        f"All values of {column.name!r} lie on a grid of {step:.6g} {column.unit}{turn}; that is used as "
        "its resolution."
    )
    return replace(column, quantum=step), [info("quantum-found", sentence)]


def _steps_in_a_turn(column: Column, channel: Channel) -> int | None:
    """The number of steps of an angle sensor that were rounded to decimals of the channel's unit; None where there are none."""
    if column.unit != "rad" or channel.unit is None:
        return None
    factor = si_factor(channel.unit)[0]
    step = last_decimal(column.x / factor)
    return None if step is None else steps_behind_decimals(column.x, step * factor)


def _through(column: Column, stages: Sequence[Stage]) -> tuple[Column, list[Finding]]:
    """Return a column after some stages, and what was found on the way."""
    findings: list[Finding] = []
    for stage in stages:
        if isinstance(stage, Unwrap):
            column, doubts = without_wraps(column, stage)
            findings += doubts
        elif isinstance(stage, Accumulate):
            column, doubts = accumulate_counts(column, stage)
            findings += doubts
        elif isinstance(stage, Scale):
            column = _scale(column, stage)
        else:
            is_new_speed = column.quantity == "position" and stage.yields("position") == "speed"
            unit = f"{column.unit}/s" if is_new_speed else column.unit
            column = replace(column, x=stage(column.x, column.t), unit=unit, quantum=None)
    return column, findings


def _scale(column: Column, stage: Scale) -> Column:
    if stage.unit is None:
        return column.times(stage.factor, column.unit)
    product = unit_named(f"({column.unit})*({stage.unit})")
    if product.quantity != column.quantity:
        raise UsageError(
            f"`{stage}` can't scale {column.name!r}, which is in {column.unit} there: expected a unit that leads from that to "
            f"another {column.quantity}, such as {'m/rad' if column.unit.startswith('rad') else 'deg/count'}"
        )
    return column.times(stage.si_factor, product.si)


def _without_conversions(chain: Chain) -> Chain:
    """The chain without its conversions of units, which a prediction in the new unit doesn't go through."""
    return Chain(tuple(s for s in chain.stages if not (isinstance(s, Scale) and s.unit is not None)))


def _findings(column: Column, declared: Chain, applied: Chain) -> list[Finding]:
    """Findings on effects of the chains that their writer may not have intended."""
    bare = [s for s in applied.stages if isinstance(s, Scale) and s.unit is None and column.unit == "counts"]
    sample_time = float(np.median(np.diff(column.t)))
    short = [s for s in declared.stages if isinstance(s, Tachometer) and s.window < 0.5 * sample_time]
    return [*map(_scale_without_unit, bare), *(_short_window(stage, sample_time) for stage in short)]


def _scale_without_unit(stage: Scale) -> Finding:
    return info(
        "scale-without-unit",
        f"`{stage}` has no unit, so it counts as part of the measurement, and the result stays in counts. If it "
        f"turns counts into an angle, write its unit: `{stage} rad/count`.",
    )


def _fractions(column: Column) -> list[Finding]:
    """A doubt of counts that aren't whole numbers, though nobody says that they were filtered or averaged."""
    broken = column.x[np.isfinite(column.x) & (column.x != np.rint(column.x))]
    if column.quantity != "position" or not len(broken):
        return []
    what = (
        f"{column.name!r} is said to be in counts, but {len(broken)} of its {len(column.x)} values aren't whole numbers, such as "
        f"{broken[0]:.6g}"
    )
    remedy = "its real unit with `output=COL:UNIT`, or the stage that averages the counts with `chain=...`."
    sentence = f"{what}. Give {remedy}"
    if are_thousands(column.x):
        sentence = (
            f"{what}, where the others suggest {1000 * broken[0]:.6g}. If the point separates thousands, export the numbers "
            f"without it; otherwise give {remedy}"
        )
    return [warning("counts-not-whole", sentence)]


def _short_window(stage: Tachometer, sample_time: float) -> Finding:
    return info(
        "window-too-short",
        f"`{stage}` looks back over less than the {sample_time:g} s between samples, which the model can't resolve: "
        f"the identified delay may be up to {0.5 * (sample_time - stage.window):.2g} s too small.",
    )
