"""The noun `InspectionReport`: what is in a file and what it can support, on one page."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

from servobench._version import __version__
from servobench.core.errors import MissingInformation, ServobenchError
from servobench.core.finding import Finding, Severity
from servobench.core.rounding import count_text, percent, plain, with_unit
from servobench.identification.trust.doubts.base import about_data
from servobench.recordings.formats.describe import ChannelDescription, Description, channels_to_show, describe
from servobench.recordings.formats.inspection import extremes, intervals
from servobench.recordings.formats.mapping import assign
from servobench.recordings.formats.times import TimeBase
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.measure import measure
from servobench.recordings.recording import Recording
from servobench.report import inspection_figures, summary, tables
from servobench.report.document import write_page
from servobench.report.html import SEVERITIES, DrawnFigure, single, source, template
from servobench.report.tables import Fact


@dataclass(frozen=True, eq=False)
class InspectionReport:
    """The content of a file's recordings, as a page that needs no network."""

    recordings: Sequence[Recording]

    def html(self) -> str:
        """Return the page. The same recordings give the same text."""
        parts = tuple(_part(recording, number) for number, recording in enumerate(self.recordings, 1))
        origin = self.recordings[0].source
        text = template("inspection.html.j2").render(
            style=source("style.css"),
            title=origin.name,
            version=__version__,
            origin=(
                Fact(heading="File", text=origin.name),
                Fact(heading="Format", text=origin.format),
                Fact(heading="SHA-256", text=origin.sha256 or "not known", code=True),
            ),
            parts=parts,
            sentence=summary.sentence,
            severity_words={str(severity): word for severity, word in SEVERITIES.items()},
            **_conclusion(parts),
        )
        # A name of a file may hold bytes that are no text.
        return text.encode("utf-8", "replace").decode("utf-8")

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the page to a file: all of it or, where that can't be done, nothing; an earlier file is replaced.

        Raises `StorageError`, which says why.
        """
        write_page(self.html(), path)


@dataclass(frozen=True, kw_only=True)
class _Part:
    """The page's section on one recording."""

    name: str
    support: str
    missing: tuple[str, ...]
    findings: tuple[tuple[Finding, ...], ...]
    facts: tuple[Fact, ...]
    channels: tuple[tuple[str, ...], ...]
    times: tuple[tuple[str, ...], ...]
    drawings: tuple[DrawnFigure, ...]


def _part(recording: Recording, number: int) -> _Part:
    description = describe(recording)
    support, missing, data = _support(recording)
    shown = channels_to_show(recording)
    spread = next(
        (spacing for name in shown if (t := recording[name].t) is not None and (spacing := intervals(t))),
        None,
    )
    drawings = [single(inspection_figures.over_time(recording, shown, number))]
    if spread is not None and not spread.is_even:
        drawings.append(single(inspection_figures.spacing(spread, number)))
    return _Part(
        name=recording.name,
        support=support,
        missing=missing,
        findings=tables.finding_groups(
            description.findings if data is None else (*data.findings, *about_data([data]))
        ),
        facts=_facts(recording, shown, data),
        channels=tuple(map(_channel_row, description.channels)),
        times=_time_rows(description),
        drawings=tuple(each for each in drawings if each is not None),
    )


def _support(recording: Recording) -> tuple[str, tuple[str, ...], Dataset | None]:
    """The recording's possible use, what has to be stated first, and the data if nothing has."""
    try:
        data = measure(assign(recording))
    except MissingInformation as error:
        return "Some information is missing before it can be identified.", error.missing, None
    except ServobenchError as error:
        return f"It can't be identified as it is: {error}", (), None
    return (
        f"It can be identified as it is: the output is a {data.kind} in {data.output_unit}, "
        f"{with_unit(data.duration, 's', 4)} long.",
        (),
        data,
    )


def _conclusion(parts: Sequence[_Part]) -> dict[str, str]:
    """The sentence at the head of the page, and the colour that it stands in."""
    ready = sum(not part.missing and part.support.startswith("It can be") for part in parts)
    refused = any(group[0].severity is Severity.REFUSAL for part in parts for group in part.findings)
    many = count_text(len(parts), "recording")
    if ready == len(parts) and not refused:
        return {"state": "trusted", "word": "Ready", "reason": f"{many}, with everything needed."}
    if any(part.missing for part in parts) and not refused:
        return {
            "state": "doubtful",
            "word": "Questions",
            "reason": f"{many}; some information is missing.",
        }
    return {"state": "refused", "word": "Not as it is", "reason": f"{many}; see the reasons."}


def _facts(recording: Recording, shown: Sequence[str], data: Dataset | None) -> tuple[Fact, ...]:
    """The facts on the input, on channels at the ends of their range, and on the measurement chain."""
    facts = []
    for name in shown:
        ends = extremes(recording[name])
        if ends is None:
            facts.append(Fact(heading=name, text="never changes"))
            continue
        unit = recording[name].channel.unit or ""
        low, high = (f"{plain(end, 4)} {unit}".strip() for end in (ends.smallest, ends.largest))
        text = (
            f"{percent(100 * ends.at_smallest)} % of the samples at the smallest value, {low}; "
            f"{percent(100 * ends.at_largest)} % at the largest, {high}; at most {count_text(ends.longest, 'sample')} in a row"
        )
        if ends.looks_limited:
            text += ". It stays nowhere else for so long, so it is limited"
        facts.append(Fact(heading=name, text=f"{text}."))
    if data is not None:
        chain = str(data.chain) or ("nothing, as declared" if data.chain_known else "not stated")
        facts.append(Fact(heading="Between shaft and output", text=chain))
    return tuple(facts)


def _channel_row(channel: ChannelDescription) -> tuple[str, ...]:
    low, high = (plain(end, 5) if end is not None else "–" for end in (channel.minimum, channel.maximum))
    return (
        channel.name,
        channel.unit or "?",
        str(channel.samples),
        low,
        high,
        str(channel.levels),
        plain(channel.quantum, 4) if channel.quantum is not None else "–",
        f"{percent(100 * channel.repeated)} %" if channel.repeated is not None else "–",
        str(channel.non_finite),
    )


def _time_rows(description: Description) -> tuple[tuple[str, ...], ...]:
    rows = []
    for number, base in enumerate(description.time_bases):
        names = [each.name for each in description.channels if each.times == number]
        more = f" and {len(names) - 3} more" if len(names) > 3 else ""
        rows.append((", ".join(names[:3]) + more, *_time_row(base)))
    return tuple(rows)


def _time_row(base: TimeBase) -> tuple[str, ...]:
    steps = (base.start, base.end, base.shortest_step, base.median_step, base.p99_step, base.longest_step)
    texts = [with_unit(value, "s", 4) if value is not None else "–" for value in steps]
    return (*texts, str(base.gaps), str(base.duplicates), str(base.backward))
