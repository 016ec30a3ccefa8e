"""Whether intervals hold on real motors: what one recording of a motor says, its other recordings must bear out.

    python bench/real.py                    all recordings, one table a motor
    python bench/real.py --motor ev3        the recordings of one motor

The recordings are other people's and no part of the project; `real_parts/recordings.py` says where they are looked for.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

os.environ.setdefault("OMP_NUM_THREADS", "1")

from figures import Figure

SMALLEST = ("ev3",)


def main(motors: Sequence[str] = ()) -> list[Figure]:
    """Return the share of trusted recordings and of intervals that hold, of some motors or of all (a minute)."""
    from real_parts.recordings import FOLDER, usable
    from real_parts.runs import outcomes

    if not FOLDER.is_dir():
        what = "real motors: not run, the recordings are absent (SERVOBENCH_REAL_DATA names their folder)"
        return [Figure(what=what, value=float("nan"))]
    return _figures(outcomes(each for each in usable() if not motors or each.motor in motors))


def smallest() -> list[Figure]:
    """Return the same figures of one motor alone."""
    return main(SMALLEST)


def _figures(found: Sequence) -> list[Figure]:
    from real_parts.judge import judged

    rows = judged(found)
    stated = sum(row.stated for row in rows)
    trusted = sum(each.verdict == "trusted" for each in found)
    return [
        Figure(
            what=f"real recordings that are trusted, of {len(found)}",
            value=100.0 * trusted / max(len(found), 1),
            unit="%",
            goal="60",
        ),
        Figure(
            what=f"intervals of a real recording that hold what the motor's others say, of {stated}",
            value=100.0 * sum(row.held for row in rows) / max(stated, 1),
            unit="%",
            goal="90",
        ),
    ]


def command(words: Sequence[str]) -> int:
    """Identify each recording, print one line each and the judgement of each motor; returns the exit status."""
    from figures import shown
    from real_parts.judge import judged, scatter_of_families
    from real_parts.recordings import usable
    from real_parts.runs import PARAMETERS, Outcome, outcomes

    parser = argparse.ArgumentParser(description="Intervals on real motors, judged by replicates.")
    parser.add_argument("--motor", action="append", help="only this motor; may be repeated")
    asked = parser.parse_args(words)

    def show(outcome: Outcome) -> None:
        values = "  ".join(
            f"{name} {one.value:.4g} ± {one.half_width:.2g}" for name, one in outcome.stated.items()
        )
        print(f"{outcome.name:60} {outcome.verdict:9} {outcome.seconds:5.1f} s  {values}", flush=True)

    found = outcomes((each for each in usable() if not asked.motor or each.motor in asked.motor), show)
    print()
    for row in judged(found):
        print(
            f"{row.motor:16} {row.parameter:16} held {row.held:2} of {row.stated:2}  consensus {row.consensus:9.4g}  "
            f"scatter {100 * row.scatter:5.1f} %  half-width / scatter {row.width:5.1f}"
        )
    print()
    for each in (each for parameter in PARAMETERS for each in scatter_of_families(found, parameter)):
        print(
            f"{each.family:16} {each.parameter:16} scatter within a motor {100 * each.own:5.1f} %, "
            f"median of the other families {100 * each.others:5.1f} %"
        )
    print()
    return shown(_figures(found))


if __name__ == "__main__":
    sys.exit(command(sys.argv[1:]))
