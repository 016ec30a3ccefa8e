"""The noun `AcceptanceReport`: what commissioning a bench found, for people to read and to sign, in one page."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace

from servobench._version import __version__
from servobench.core.rounding import count_text, milliseconds, plain
from servobench.recordings.recording import Recording
from servobench.report.document import write_page
from servobench.report.html import DrawnFigure, single, source, template
from servobench.report.inspection_figures import over_time
from servobench.report.tables import Fact
from servobench.rig.commission.acceptance import Acceptance, Checked
from servobench.rig.commission.checks.base import State

TONES: Mapping[State, str] = {
    "verified": "trusted",
    "failed": "refused",
    "unsupported": "doubtful",
    "unknown": "doubtful",
}
"""The look of each state, by what the page's style knows."""


@dataclass(frozen=True, eq=False)
class AcceptanceReport:
    """The report of a commissioning, with the recordings by their names, as a page that opens from disk without a network."""

    acceptance: Acceptance
    """The report of a commissioning."""
    recordings: Mapping[str, Recording]

    def html(self) -> str:
        """Return the page. The same acceptance gives the same text."""
        acceptance = self.acceptance
        text = template("commission.html.j2").render(
            style=source("style.css"),
            title=acceptance.info.name + (f" ({acceptance.info.serial})" if acceptance.info.serial else ""),
            version=__version__,
            identity=_identity(acceptance),
            signature=_signature(acceptance),
            parts=tuple(self._part(each) for each in acceptance.checks),
            **conclusion(acceptance),
        )
        # A port's name may hold bytes that are no text.
        return text.encode("utf-8", "replace").decode("utf-8")

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the page to a file: all of it or, where that can't be done, nothing; an earlier file is replaced.

        Raises `StorageError`, which says why.
        """
        write_page(self.html(), path)

    def _part(self, checked: Checked) -> _Part:
        outcome = checked.outcome
        texts = {
            "Done": outcome.did,
            "Expected": outcome.expected,
            "Measured": "; ".join(f"{each.name}: {each}" for each in outcome.figures),
            "What to do": outcome.remedy,
            "Recordings": ", ".join(f"{name}.mcap" for name in checked.recordings),
        }
        return _Part(
            name=checked.name.replace("_", "-"),
            title=checked.title,
            state=outcome.state,
            tone=TONES[outcome.state],
            found=outcome.found,
            facts=tuple(Fact(heading=heading, text=text) for heading, text in texts.items() if text),
            drawing=self._drawing(checked),
        )

    def _drawing(self, checked: Checked) -> DrawnFigure | None:
        """The longest run of a check that people would rather look at, the last one of several."""
        shown = [name for name in checked.recordings if name in self.recordings]
        if not (checked.picture and shown):
            return None
        name = max(shown, key=lambda name: (len(self.recordings[name]["counts"].values), shown.index(name)))
        recording = self.recordings[name]
        names = ("commanded", "counts") if "commanded" in recording else ("counts",)
        illustration = over_time(recording, names, len(shown))
        if illustration is None:
            return None
        named = replace(
            illustration,
            name=f"check-{checked.name.replace('_', '-')}",
            title=checked.title,
            caption=f"{checked.picture} ({name}.mcap)",
        )
        return single(named)


@dataclass(frozen=True, kw_only=True)
class _Part:
    """The page's part on one check."""

    name: str
    title: str
    state: State
    tone: str
    found: str
    facts: tuple[Fact, ...]
    drawing: DrawnFigure | None


def conclusion(acceptance: Acceptance) -> dict[str, str]:
    """Return the `state` of the whole (a tone of the page), the `word` for it and the `reason`."""
    counts = ", ".join(f"{number} {state}" for state, number in acceptance.counts.items() if number)
    reason = f"{count_text(len(acceptance.checks), 'check')}: {counts}."
    if acceptance.ended:
        reason += f" It ended early: {acceptance.ended}."
    if acceptance.failed:
        return {"state": "refused", "word": "Failed", "reason": reason}
    if acceptance.counts["verified"] == len(acceptance.checks):
        return {"state": "trusted", "word": "Accepted", "reason": reason}
    return {"state": "doubtful", "word": "Nothing failed, but not all is verified", "reason": reason}


def _identity(acceptance: Acceptance) -> tuple[Fact, ...]:
    """The facts on the device that was commissioned, and on the software."""
    info = acceptance.info
    settings = dict(info.settings)
    firmware = settings.pop("firmware", "")
    counts = info.channel("counts")
    encoder = []
    if counts is not None:
        encoder += [f"{plain(counts.counts_per_rev, 7)} counts a turn"] if counts.counts_per_rev else []
        encoder += [f"a counter of {counts.counter_bits} bits"] if counts.counter_bits else []
    texts = {
        "Device": info.name,
        "Serial number or port": info.serial or "not reported",
        "Firmware": firmware or "not reported",
        "Settings": ", ".join(f"{name} = {value}" for name, value in settings.items()) or "the defaults",
        "Encoder, as reported": ", ".join(encoder) or "nothing",
        "Voltage limit": f"{plain(acceptance.voltage_limit)} V",
        "Sample time": f"{milliseconds(acceptance.sample_time)} ms",
        "Carried out": acceptance.created.replace("T", " ").replace("+00:00", " UTC"),
        "Software": f"servobench {acceptance.version}",
    }
    return tuple(Fact(heading=heading, text=text) for heading, text in texts.items())


def _signature(acceptance: Acceptance) -> tuple[Fact, ...]:
    signed = acceptance.signature
    if signed is None:
        return (Fact(heading="Signed off by", text="nobody yet"), Fact(heading="On", text="–"))
    return (Fact(heading="Signed off by", text=signed.name), Fact(heading="On", text=signed.date))
