"""The noun `ExplanationReport`: why figures differ, on one page."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field

from servobench._version import __version__
from servobench.core.finding import Severity
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import plain, with_unit
from servobench.identification.reconciliation.explanation import Explanation
from servobench.identification.reconciliation.reenactment import SPOKEN
from servobench.identification.reconciliation.sentences import probability_text, share_text, size_range_text
from servobench.recordings.recording import Recording
from servobench.report import explanation_figures, summary, tables
from servobench.report.document import write_page
from servobench.report.html import SEVERITIES, single, source, template
from servobench.report.tables import Fact


@dataclass(frozen=True, eq=False)
class ExplanationReport:
    """An explanation, and the recordings that it is about, as a page that opens from disk without a network.

    `command` is what made it, to be told on the page; empty where nobody typed one.
    """

    recordings: Sequence[Recording]
    explanation: Explanation
    command: str = field(default="", kw_only=True)

    def html(self) -> str:
        """Return the page. The same explanation gives the same text."""
        explanation = self.explanation
        drawings = (explanation_figures.readings(explanation), explanation_figures.causes(explanation))
        text = template("explanation.html.j2").render(
            style=source("style.css"),
            version=__version__,
            title=_title(explanation),
            state=str(explanation.verdict),
            sentences=explanation.sentences,
            drawings=tuple(
                drawing for each in drawings if not explanation.agrees and (drawing := single(each))
            ),
            shares=tuple(parameter_in_words(each.name) for each in explanation.differences),
            causes=_causes(explanation),
            readings=_readings(explanation),
            experiment=explanation.decision.experiment.to_toml()
            if explanation.decision and explanation.decision.experiment
            else "",
            findings=tables.finding_groups(
                tuple(each for each in explanation.findings if each.severity != Severity.INFO)
            ),
            origin=self._origin(),
            sentence=summary.sentence,
            severity_words={str(severity): word for severity, word in SEVERITIES.items()},
        )
        # A name of a file may hold bytes that are no text.
        return text.encode("utf-8", "replace").decode("utf-8")

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the page to a file: all of it or, where that can't be done, nothing; an earlier file is replaced.

        Raises `StorageError`, which says why.
        """
        write_page(self.html(), path)

    def _origin(self) -> tuple[Fact, ...]:
        files = tuple(
            Fact(heading=each.name, text=each.source.sha256 or "not known", code=True)
            for each in self.recordings
        )
        command = (Fact(heading="Command", text=self.command, code=True),) if self.command else ()
        return (*command, *files)


def _title(explanation: Explanation) -> str:
    if not explanation.differences:
        return "No answer"
    values = " and ".join(with_unit(each.other, each.unit) for each in explanation.differences)
    first = " and ".join(with_unit(each.data, each.unit, 3) for each in explanation.differences)
    return f"Why {values} and not {first}"


def _causes(explanation: Explanation) -> tuple[tuple[str, ...], ...]:
    """A row for each cause: its name, how probable it is, what it explains of each difference, and what there is to say."""
    rows = []
    for each in explanation.causes:
        shares = {share.name: share_text(share) for share in each.explains}
        texts = (shares.get(d.name, "–") for d in explanation.differences)
        needed = "" if each.needed is None else size_range_text(each.needed)
        against = each.against and f"{'; ' if needed else ''}{each.against}"
        probability = probability_text(each.probability) if each.possible else "–"
        rows.append((each.label, each.law, f"{needed}{against}", probability, *texts))
    return tuple(rows)


def _readings(explanation: Explanation) -> tuple[tuple[str, ...], ...]:
    """A row for each method: its name, the gain and the time constant that it reads, or why it reads none."""
    rows = []
    for each in explanation.readings:
        values = (
            ("–", each.why_not) if each.why_not else (plain(each.gain), with_unit(each.time_constant, "s"))
        )
        rows.append((SPOKEN[each.method], *values))
    return tuple(rows)
