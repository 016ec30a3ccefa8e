"""A recording with everything stated about it: its columns, units, times, and the place of its measurement chain."""

from __future__ import annotations

from dataclasses import dataclass, replace

from servobench.core.finding import Finding, info, warning
from servobench.core.units import unit as unit_named
from servobench.recordings.formats.likely_units import about_output_unit
from servobench.recordings.formats.mapping import Mapping
from servobench.recordings.formats.roles import plain_name
from servobench.recordings.measurement.accumulate import Accumulate
from servobench.recordings.measurement.base import Chain, Stage
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.measure import measure
from servobench.recordings.measurement.scale import Scale
from servobench.recordings.measurement.unwrap import Unwrap
from servobench.recordings.recording import Recording

# Words in the name of a column that went through a filter.
_FILTERS = frozenset(
    {"filt", "filtered", "smooth", "smoothed", "avg", "average", "averaged", "mean", "ema", "lpf", "lowpass"}
)


@dataclass(frozen=True)
class Evidence:
    """A recording with its roles and units known, and the text of the chain through which its output is still to go."""

    recording: Recording
    chain: str = ""

    def dataset(self, starts_at_rest: bool = False) -> Dataset:
        """Return what identification works on; raises what `measure` does."""
        return measure(self.recording, self.chain, starts_at_rest)


def evidence_of(recording: Recording, mapping: Mapping) -> Evidence:
    """Return a recording with roles, units and times as a mapping says, and its chain where it belongs."""
    assigned = replace(mapping, chain="").assign_to(recording)
    chain = Chain.parse(mapping.chain or assigned.chain)
    is_scaled = any(isinstance(stage, Scale) for stage in chain.stages)
    doubts = [] if is_scaled else about_output_unit(assigned[str(assigned.output)])
    return with_chain(assigned.with_findings(*doubts), mapping.chain)


def with_chain(recording: Recording, text: str) -> Evidence:
    """Return the recording with the chain that lies between its shaft and its output, where it belongs.

    A chain that turns a position into a speed can't have been passed by a column that is still a position; no more can one that
    only changes what the column's unit is, takes its wraps away, or adds it up, have been passed by a column that is in the unit
    from before. Such a chain is applied now, and a finding says so. Any other is what happened before the recording, `none`
    included. Where there is none, and the output's name says that it was filtered, that is doubted.
    Raises `UsageError` for a text that is no chain.
    """
    chain = Chain.parse(text)
    output, unit = _output(recording)
    if not chain.stages:
        stated = replace(recording, chain=text.strip() or recording.chain)
        return Evidence(stated.with_findings(*_filters_in_name(stated)))
    if not _is_chain_pending(chain, unit):
        return Evidence(replace(recording, chain=text))
    finding = info(
        "chain-applied",
        f"The output `{output}` is in {unit}, the unit before `{chain}`, so the chain is applied now.",
    )
    return Evidence(recording.with_findings(finding), text)


def _output(recording: Recording) -> tuple[str, str]:
    """The name and the unit of the output, which has both by now."""
    name = recording.output or ""
    return name, recording[name].channel.unit or ""


def _is_chain_pending(chain: Chain, unit: str) -> bool:
    if unit_named(unit).quantity != "position":
        return False
    if chain.yields("position") == "speed":
        return True
    return all(_leaves_a_position(stage, unit) for stage in chain.stages)


def _leaves_a_position(stage: Stage, unit: str) -> bool:
    """Whether a stage takes a position in that unit to another unit, takes the wraps out of it, or adds it up."""
    if isinstance(stage, Accumulate):
        return True
    if isinstance(stage, Unwrap):
        return unit_named(stage.unit).si == unit_named(unit).si
    if isinstance(stage, Scale) and stage.unit is not None:
        return unit_named(f"({unit})*({stage.unit})").quantity == "position"
    return False


def _filters_in_name(recording: Recording) -> list[Finding]:
    """A doubt of an output whose name says that it was filtered, where nobody says how."""
    name, _ = _output(recording)
    words = plain_name(name).split("_")
    if recording.chain or not _FILTERS & set(words):
        return []
    rest = [word for word in words if word not in _FILTERS]
    names = (series.channel.name for series in recording.series)
    raw = next((each for each in names if each != name and plain_name(each).split("_") == rest), None)
    before = f"use `{raw}`, which looks like the same before" if raw else "use the output before it"
    sentence = (
        f"The name of the output `{name}` says that it was filtered, but nothing says how, and the filter's lag would be taken "
        f"for the motor's. Name it with `chain=...` (`chain=none` if there is no filter), or {before}."
    )
    return [warning("output-filtered", sentence, parameters=("time_constant", "delay"))]
