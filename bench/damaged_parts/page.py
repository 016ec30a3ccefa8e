"""The table in words and in figures: docs/benchmarks/damaged.md and damaged.json."""

import json
from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from damaged_parts.runs import Run
from servobench._version import __version__

_WORDS = (
    "Recordings of the simulated device (500 Hz, 10 s unless the table says otherwise; inertia and motor constant drawn within",
    "±5 %) are damaged, mildly and severely, and identified as a user's file would be. A **hit** is a finding with one of the",
    "codes that are right for the damage; the codes are those that came, with the number of runs. A **false alarm** is any",
    "warning or refusal about a sound recording. Some mild damages change the result by less than its interval (a few duplicate",
    "rows); they are told all the same.",
    "",
    "What can't be seen in principle, and isn't in the table: a level of a two-level input that isn't what its label says (it is",
    "another gain or offset), an input that is clipped the same at all its levels, times or units that are all wrong by one",
    "factor where no data sheet is given and the size is still a motor's, and a sign that is wrong throughout (`sign-negative`",
    "tells the sense).",
)  # fmt: skip


def write(damaged: Sequence[Run], sound: Sequence[Run], out: Path) -> None:
    """Write both files."""
    out.mkdir(parents=True, exist_ok=True)
    made = {"date": datetime.now(UTC).date().isoformat(), "version": __version__}
    (out / "damaged.md").write_text(markdown(damaged, sound, made), encoding="utf-8")
    rows = [_row(runs) for runs in _grouped(damaged)]
    alarms = [_row(runs) for runs in _grouped(sound)]
    text = json.dumps({**made, "damaged": rows, "sound": alarms}, indent=1, ensure_ascii=False)
    (out / "damaged.json").write_text(text + "\n", encoding="utf-8")


def markdown(damaged: Sequence[Run], sound: Sequence[Run], made: dict[str, str]) -> str:
    """Return the page."""
    hits, alarms = sum(run.hit for run in damaged), sum(bool(run.grave) for run in sound)
    groups = _grouped(damaged)
    return "\n".join(
        [
            "# Damaged recordings: hits and false alarms",
            "",
            f"Made by `python bench/damaged.py` on {made['date']} with servobench {made['version']}.",
            "",
            *_WORDS,
            "",
            f"**{hits} of {len(damaged)} damaged recordings are told by the right name ({len(groups)} damages), with "
            f"{alarms} false alarms in {len(sound)} sound ones.**",
            "",
            "## Damaged",
            "",
            "| damage | severity | what was done | hits | codes | verdicts |",
            "| --- | --- | --- | --- | --- | --- |",
            *(_line(runs) for runs in groups),
            "",
            "## Sound",
            "",
            "| recording | false alarms | codes |",
            "| --- | --- | --- |",
            *(_sound_line(runs) for runs in _grouped(sound)),
            "",
        ]
    )


def _grouped(runs: Sequence[Run]) -> list[list[Run]]:
    groups: dict[tuple[str, str, str], list[Run]] = {}
    for run in runs:
        groups.setdefault((run.kind, run.severity, run.words), []).append(run)
    return list(groups.values())


def _line(runs: list[Run]) -> str:
    one = runs[0]
    hits = sum(run.hit for run in runs)
    right = Counter(code for run in runs for code in run.codes if code in run.wanted)
    verdicts = Counter(run.verdict for run in runs)
    return (
        f"| {one.kind} | {one.severity} | {one.words} | {hits}/{len(runs)} | {_counted(right, len(runs))} | "
        f"{_counted(verdicts, len(runs))} |"
    )


def _sound_line(runs: list[Run]) -> str:
    alarms = sum(bool(run.grave) for run in runs)
    codes = Counter(code for run in runs for code in run.grave)
    return f"| {runs[0].words} | {alarms}/{len(runs)} | {_counted(codes, len(runs))} |"


def _counted(found: Counter[str], runs: int) -> str:
    """Names, with the number of runs where it isn't all of them."""
    return ", ".join(name if count == runs else f"{name} ({count})" for name, count in found.most_common())


def _row(runs: list[Run]) -> dict[str, object]:
    one = runs[0]
    return {
        "damage": one.kind,
        "severity": one.severity,
        "words": one.words,
        "wanted": list(one.wanted),
        "runs": len(runs),
        "hits": sum(run.hit for run in runs),
        "verdicts": dict(Counter(run.verdict for run in runs)),
        "grave": dict(Counter(code for run in runs for code in run.grave)),
    }
