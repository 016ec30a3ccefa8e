"""A stream watched: its rows recorded as they come, followed by the live estimate, and given to identification in the end."""

from __future__ import annotations

import os
from collections.abc import Mapping as Table
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from servobench._version import __version__
from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.finding import Finding, Severity, info
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import count_text, plain
from servobench.core.units import unit
from servobench.identification.design.stopping_rule import StoppingRule
from servobench.identification.estimators.recursion.motion import Samples
from servobench.identification.estimators.recursion.start import Setting
from servobench.identification.live import BOTH_WAYS, LiveEstimate
from servobench.identification.result import Result
from servobench.identification.trust.doubts.time_unit import likely_unit, may_be_milliseconds
from servobench.recordings.evidence import Evidence
from servobench.recordings.formats.mapping import Mapping
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.unwrap import Unwrap
from servobench.recordings.native.reader import read
from servobench.recordings.native.writer import RecordingWriter, Together
from servobench.recordings.recording import Recording, Series, Source, Stopped, StopReason
from servobench.recordings.streams.base import Rows
from servobench.recordings.streams.intake import Intake, Part

KNOWN = {"gain": 0.02, "time_constant": 0.05}
"""The default half-widths over the values that are enough."""

_COUNTERS = (16, 32)  # bits of the counters whose wraps are recognised
_RANGES = tuple(2.0**bits for bits in _COUNTERS)
_PAUSE = (
    0.25  # s without rows, in which the input may have changed: what comes then is a recording of its own
)
_LOST = 10  # rows in a pause at least: single lost ones of a slow stream are no pause
_BLIND = (
    5.5  # sample times, five lost rows, in which the input changed: when nobody knows, and a model needs it
)
_FEWEST = 20  # rows: fewer than any structure needs for a model


class Watch:
    """A stream from its first row to its last, recorded in the native file `to`.

    `mapping` says what the columns are, `name` what the stream is called, `wish` how well the parameters are to be known. Raises
    what `Intake` and `RecordingWriter` raise.

    >>> from servobench.recordings.formats.mapping import Mapping
    >>> Watch(Mapping(), "standard input", "watched.mcap").sentence()
    'waiting for rows'
    """

    def __init__(
        self, mapping: Mapping, name: str, to: str | os.PathLike[str], wish: Table[str, float] | None = None
    ) -> None:
        self._intake = Intake(mapping, name)
        self._path = Path(to)
        self._name = name
        self._wish = dict(KNOWN if wish is None else wish)
        self._writer: RecordingWriter | None = None
        self._evidence: Evidence | None = None
        self._live: LiveEstimate | None = None
        self._travel = _Travel()
        self._input: float | None = None
        self._begun: float | None = None
        self._watched = 0.0
        self._last = 0.0
        self._looked = 0
        self._slow = 0.0
        self._chains: list[str] = []
        self._rule = StoppingRule(self._wish)
        self._judged: Result | None = None

    @property
    def rows(self) -> int:
        """The number of rows that are recorded."""
        return self._intake.rows

    @property
    def lost(self) -> int:
        """The number of rows that are missing between them."""
        return self._intake.order.lost if self._intake.order else 0

    @property
    def damaged(self) -> int:
        """The number of lines that were no rows."""
        return self._intake.damaged

    @property
    def duration(self) -> float:
        """The time for which the stream was watched, by its own clock [s]."""
        return self._watched + (0.0 if self._begun is None else self._last - self._begun)

    def take(self, rows: Rows) -> None:
        """Record rows, and let the estimate follow them."""
        for part in self._intake.take(rows):
            self._take(part)

    def look_again(self) -> None:
        """Estimate from all rows so far now, where some have come since the last look: no more come for a while."""
        rows = self.rows
        if self._live is not None and rows > self._looked:
            self._live.look_again()
            self._looked = rows

    def end(self, stopped: Stopped, last: Rows | None = None) -> list[Evidence]:
        """Finish the file and return the recordings in it to be identified: each time the clock began again is another one.

        Raises `UsageError` where there weren't rows enough for one.
        """
        if last is not None:
            self.take(last)
        for part in self._intake.end():
            self._take(part)
        self.look_again()
        if self._writer is None:
            came = self._intake.unread
            instead = (
                f"; the last line was {came!r}, but rows like 0.001,1.5,2048 were expected" if came else ""
            )
            raise UsageError(f"{self._name}: no usable rows came{instead}; nothing was recorded")
        self._finish(stopped)
        self._writer.close()
        evidence = [Evidence(each, chain) for each, chain in zip(read(self._path), self._chains, strict=True)]
        return _without_stubs(evidence)

    def abandon(self) -> None:
        """Let go of the file; what is in it stays."""
        if self._writer is not None:
            self._writer.abandon()

    def message(self) -> dict[str, Any] | None:
        """Return the `live` message of `LiveEstimate`; None where there is nothing to follow yet, or no position."""
        return None if self._live is None else self._live.message()

    @property
    def enough(self) -> bool:
        """Whether the parameters are known as well as wished by what noise does to them alone."""
        return self._live is not None and bool(self._live.message()["enough"])

    @property
    def known(self) -> bool:
        """Whether they are known as well as wished with what the model may be wrong by, as far as `judge` was told."""
        return self._judged is not None and self._rule.is_met(self._judged)

    def so_far(self) -> list[Evidence]:
        """Return the recordings up to now as the file holds them; raises what `read` does."""
        if self._writer is None:
            return []
        chains = [*self._chains, *([self._chain()] if self._evidence is not None else [])]
        part = self._path.with_name(f"{self._path.name}.part")
        evidence = [
            Evidence(_as_it_grows(each), chain) for each, chain in zip(read(part), chains, strict=False)
        ]
        return _without_stubs(evidence)

    def judge(self, result: Result) -> None:
        """Take what identification says of the rows so far: its intervals hold what the live ones don't."""
        self._judged = result

    def sentence(self) -> str:
        """Return in one sentence whether enough is known, and how well, or else which motion is missing."""
        if self._evidence is None and not self._chains:
            return "waiting for rows"
        if self._slow:
            name, symbol = likely_unit(self._slow)
            return (
                f"the rows are {plain(self._slow, 3)} s apart, which is slow for a motor; if the time column is in {name}, "
                f"stop and start again with `time=COL:{symbol}`"
            )
        if self._live is None:
            return "recording; a speed is identified at the end, a position also live"
        both = f"; to tell friction from offset it {BOTH_WAYS}" if self._live.turned_one_way else ""
        if self._judged is not None:
            progress = self._rule.progress_text(self._judged)
            if self.known:
                return f"enough is known: {progress}{both}"
            if doubt := _first_warning(self._judged):
                # More of the same motion would change nothing of that.
                return f"{self._judged.verdict}: {doubt}"
            return f"needs more motion, and other motion: with the model error, {progress}{both}"
        if self.enough:
            parameters = self._live.message()["parameters"]
            share = " and ".join(
                f"{parameter_in_words(name)} {_share(parameters[name])}" for name in self._wish
            )
            return f"by noise alone {share}; the model error comes on top{both}"
        if self._live.message()["white"] is False:
            return "the motor doesn't do what the model says: look for play, a load that changes, or a limit that it reaches"
        return " and ".join(self._live.missing_motions()) or "needs more of the same motion"

    def _take(self, part: Part) -> None:
        if part.link == "restart":
            self._finish(Stopped(reason="finished", sentence="the clock of the stream began again"))
        elif self._evidence is not None and (paused := self._pause(part)) > self._longest_pause(part):
            # The input in between is unknown, and no model bridges that.
            self._finish(Stopped(reason="finished", sentence=f"no rows came for {paused:.3g} s"))
        if self._evidence is None:
            self._begin(part)
        elif part.link == "rate" and self._live is not None:
            self._live = self._new_estimate(part)  # its filters are made for one rate
        series = part.recording.series
        t = np.asarray(series[0].t)
        self._begun, self._last = t[0] if self._begun is None else self._begun, float(t[-1])
        if self._writer is not None:
            self._writer.append(0, np.column_stack([t, *(each.values for each in series)]))
        if self._live is not None:
            self._follow(self._live, part, t)
        self._input = float(_role(part.recording, "input").values[-1])

    def _pause(self, part: Part) -> float:
        """The pause before these rows, by the stream's clock [s]; zero where they follow those before."""
        t = part.recording.series[0].t
        return float(t[0]) - self._last if part.link == "gap" and t is not None else 0.0

    def _longest_pause(self, part: Part) -> float:
        """The longest gap [s] before these rows that a model bridges: shorter if the input changed in it."""
        changed = _role(part.recording, "input").values[0] != self._input
        return _BLIND * part.sample_time if changed else max(_PAUSE, _LOST * part.sample_time)

    def _begin(self, part: Part) -> None:
        """Begin a recording: its columns are those of the first rows."""
        recording = part.recording
        number = len(self._chains) + 1
        opening = replace(
            recording,
            name="stream" if number == 1 else f"stream {number}",
            series=tuple(
                Series(channel=each.channel, values=np.empty(0), t=np.empty(0)) for each in recording.series
            ),
            source=Source(name=self._name, format="stream"),
            versions={"servobench": __version__},
        )
        if self._writer is None:
            self._writer = RecordingWriter(self._path)
        t = recording.series[0].t
        names = tuple(each.channel.name for each in recording.series)
        self._writer.begin(opening, [Together(channels=names)], earliest=0.0 if t is None else float(t[0]))
        self._evidence = replace(part.evidence, recording=opening)
        self._travel = _Travel.of(self._evidence)
        self._slow = part.sample_time if may_be_milliseconds(recording.findings, part.sample_time) else 0.0
        if self._live is None:
            self._live = self._new_estimate(part)
        else:
            self._live.start_again()

    def _finish(self, stopped: Stopped) -> None:
        if self._writer is None or self._evidence is None:
            return
        findings = [*self._evidence.recording.findings, *self._intake.findings()]
        chain = self._chain()
        if chain != self._evidence.chain:
            findings.append(_about_wraps(self._travel))
        self._writer.end(stopped, tuple(findings))
        self._chains.append(chain)
        self._watched = self.duration
        self._evidence, self._begun, self._input = None, None, None

    def _chain(self) -> str:
        """The chain that the output of the present recording is still to go through, the wraps of its counter included."""
        stated = self._evidence.chain if self._evidence is not None else ""
        return stated or (f"unwrap {self._travel.bits} bit" if self._travel.wraps else "")

    def _new_estimate(self, part: Part) -> LiveEstimate | None:
        """An estimate that can follow such rows; None for a speed, or for a position behind filters."""
        output, input_ = _role(part.recording, "output"), _role(part.recording, "input")
        kind = unit(output.channel.unit or "")
        if kind.quantity != "position" or (part.recording.chain not in ("", "none")):
            return None
        quantum = _step(output, kind.factor)
        setting = Setting(quantum=quantum, sample_time=part.sample_time)
        is_angle = kind.si in ("rad", "counts")
        return LiveEstimate(
            setting,
            self._wish,
            kind.si if not is_angle else _angle_unit(output),
            unit(input_.channel.unit or "").si,
        )

    def _follow(self, live: LiveEstimate, part: Part, t: Array) -> None:
        output, input_ = _role(part.recording, "output"), _role(part.recording, "input")
        factor = unit(input_.channel.unit or "").factor
        if part.link == "gap" and input_.values[0] != self._input:
            # The input in between is unknown.
            live.start_again(None if self._input is None else factor * self._input)
        u = factor * input_.values
        y = self._travel.take(output.values) * _factor(output)
        quantum = _step(output, 1.0)
        if output.channel.counts_per_rev and quantum:
            y = y + 0.5 * quantum
        live.take(Samples(t=t, y=y, t_in=t, u=u))


def _as_it_grows(recording: Recording) -> Recording:
    """A recording without the remark that its file has no end, which is still to come."""
    return replace(
        recording, findings=tuple(each for each in recording.findings if each.code != "recording-cut-short")
    )


def _without_stubs(evidence: list[Evidence]) -> list[Evidence]:
    """The recordings that are long enough for a model, with a finding for those that aren't; all where none is."""
    long = [each for each in evidence if len(each.recording.series[0].values) >= _FEWEST]
    if not long or len(long) == len(evidence):
        return evidence
    stubs = [each.recording for each in evidence if each not in long]
    listed = ", ".join(f"{each.name} of {count_text(len(each.series[0].values), 'row')}" for each in stubs)
    sentence = f"Left out, as too short for a model, between restarts or pauses of the stream: {listed}."
    first = long[0].recording
    marked = replace(first, findings=(*first.findings, info("stream-stub", sentence)))
    return [replace(long[0], recording=marked), *long[1:]]


class _Travel:
    """Counts without the wraps of a counter of usual width: a jump of nearly its range, after which the motion goes on."""

    def __init__(self, stage: Unwrap | None = None, counts: bool = True) -> None:
        self.wraps = 0
        self.bits = 0
        self._modulus = stage.modulus if stage else 0.0
        self._moduli = list(_RANGES) if counts and stage is None else []
        self._last: float | None = None
        self._fastest = 1.0
        self._added = 0.0

    @classmethod
    def of(cls, evidence: Evidence) -> _Travel:
        """Return it for an output that wraps as the chain says, or as counters do."""
        stages = Chain.parse(evidence.chain).stages if evidence.chain else ()
        stage = next((each for each in stages if isinstance(each, Unwrap)), None)
        symbol = _role(evidence.recording, "output").channel.unit or ""
        if stage is not None and unit(symbol).si != "counts":
            stage = replace(stage, modulus=stage.si_modulus / unit(symbol).factor)
        return cls(stage, unit(symbol).si == "counts")

    def take(self, values: Array) -> Array:
        """Return values (N,) without wraps."""
        steps = np.diff(values, prepend=values[0] if self._last is None else self._last)
        if self._modulus:
            turns = np.rint(steps / self._modulus)
        else:
            turns = np.zeros(len(steps))
            for at in np.flatnonzero(np.abs(steps) > 0.5 * min(self._moduli, default=np.inf)):
                turns[at] = self._turn(float(steps[at]))
        small = np.abs(steps[(turns == 0) & (np.abs(steps) <= 0.5 * (self._modulus or min(_RANGES)))])
        self._fastest = max(self._fastest, float(small.max(initial=0.0)))
        self.wraps += int(np.count_nonzero(turns))
        self._last = float(values[-1])
        modulus = self._modulus or (2.0**self.bits if self.bits else 0.0)
        added = self._added - np.cumsum(turns) * modulus
        self._added = float(added[-1])
        out: Array = values + added
        return out

    def _turn(self, step: float) -> float:
        """The wraps in a step of counts, up or down; none where no usual width explains it."""
        for modulus in self._moduli:
            if abs(abs(step) - modulus) <= max(2 * self._fastest, 2.0):
                self.bits = int(np.log2(modulus))
                self._moduli = [modulus]
                return float(np.sign(step))
        return 0.0


def _about_wraps(travel: _Travel) -> Finding:
    return info(
        "stream-counter-wraps",
        f"The counter wrapped {count_text(travel.wraps, 'time')} at {travel.bits} bits; the wraps are removed.",
    )


def _role(recording: Recording, role: str) -> Series:
    return recording[str(recording.input if role == "input" else recording.output)]


def _factor(output: Series) -> float:
    """The factor of an output to rad or m; 1 for counts where the counts of a turn are unknown."""
    if output.channel.counts_per_rev and unit(output.channel.unit or "").si == "counts":
        return 2 * np.pi / output.channel.counts_per_rev
    return unit(output.channel.unit or "").factor


def _step(output: Series, factor: float) -> float | None:
    """The encoder's step [rad], where it is known; counts of an unknown turn have steps of one."""
    channel = output.channel
    if unit(channel.unit or "").si == "counts":
        return _factor(output)
    return channel.resolution * factor if channel.resolution else None


def _angle_unit(output: Series) -> str:
    counts = unit(output.channel.unit or "").si == "counts"
    return "counts" if counts and not output.channel.counts_per_rev else "rad"


def _share(parameter: Table[str, Any]) -> str:
    low, high = parameter["interval"]
    return f"± {100 * 0.5 * (high - low) / abs(parameter['value']):.2g} %"


def stop_text(reason: str) -> Stopped:
    """Return why watching ended: `end` of the stream, `known` enough, `time` over, or `interrupted` by the user."""
    sentences: dict[str, tuple[StopReason, str]] = {
        "end": ("finished", "the stream ended"),
        "known": ("finished", "stopped when enough was known"),
        "time": ("finished", "stopped at the time limit"),
        "interrupted": ("interrupted", "interrupted; the motor isn't driven from here"),
    }
    kind, sentence = sentences[reason]
    return Stopped(reason=kind, sentence=sentence)


def _first_warning(result: Result) -> str:
    """The first sentence of a result's first warning, without its stop; empty where nothing warns."""
    sentences = [each.sentence for each in result.findings if each.severity == Severity.WARNING]
    return sentences[0].partition(". ")[0].rstrip(".") if sentences else ""
