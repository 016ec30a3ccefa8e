"""A recording with everything stated about it: its columns, units, times, and the place of its measurement chain."""

from __future__ import annotations

from dataclasses import dataclass, replace

from servobench.core.finding import info
from servobench.core.units import unit as unit_named
from servobench.recordings.formats.mapping import Mapping
from servobench.recordings.measurement.base import Chain, Stage
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.measure import measure
from servobench.recordings.measurement.scale import Scale
from servobench.recordings.measurement.unwrap import Unwrap
from servobench.recordings.recording import Recording


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
    return with_chain(replace(mapping, chain="").assign_to(recording), mapping.chain)


def with_chain(recording: Recording, text: str) -> Evidence:
    """Return the recording with the chain that lies between its shaft and its output, where it belongs.

    A chain that turns a position into a speed can't have been passed by a column that is still a position; no more can one that
    only changes what the column's unit is, or takes its wraps away, have been passed by a column that is in the unit from before.
    Such a chain is applied now, and a finding says so. Any other is what happened before the recording, `none` included.
    Raises `UsageError` for a text that is no chain.
    """
    chain = Chain.parse(text)
    output, unit = _output(recording)
    if not chain.stages:
        return Evidence(replace(recording, chain=text.strip() or recording.chain))
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
    return all(_changes_only_the_unit(stage, unit) for stage in chain.stages)


def _changes_only_the_unit(stage: Stage, unit: str) -> bool:
    """Whether a stage takes a position in that unit to another unit, or takes the wraps out of it."""
    if isinstance(stage, Unwrap):
        return unit_named(stage.unit).si == unit_named(unit).si
    if isinstance(stage, Scale) and stage.unit is not None:
        return unit_named(f"({unit})*({stage.unit})").quantity == "position"
    return False
