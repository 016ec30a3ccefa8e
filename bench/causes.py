"""The rate of false causes: on plain simulated motors, and on real recordings whose cause is known.

    python bench/causes.py                  300 plain motors and all real recordings
    python bench/causes.py --plain 600 --first 1000    other plain motors
    python bench/causes.py --real           the real recordings alone

Every accusation is printed with its sentence. The real recordings are other people's and no part of the project.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections import Counter
from collections.abc import Sequence

os.environ.setdefault("OMP_NUM_THREADS", "1")

from figures import Figure

PLAIN = 300
SMALLEST = 4
EACH = 0.5  # % of plain records that may be told any one cause
ALL = 3.0  # % of plain records that may be told a cause at all


def main(plain: int = PLAIN, first: int = 0, real: bool = True) -> list[Figure]:
    """Return the rates of false accusations on plain motors and on real recordings (some minutes)."""
    from causes_parts.known import real_ones
    from causes_parts.told import Told
    from causes_parts.told import plain as plain_ones

    def show(told: Told) -> None:
        for sentence in told.sentences if told.codes else ():
            print(f"{told.name}: {', '.join(told.codes)}: {sentence}", flush=True)

    figures = _rates(plain_ones(range(first, first + plain), show)) if plain else []
    return [*figures, *(_real(real_ones(show)) if real else [])]


def smallest() -> list[Figure]:
    """Return the same figures of a few plain motors alone."""
    return main(plain=SMALLEST, real=False)


def _rates(told: Sequence) -> list[Figure]:
    """The rate of each accusation that was made at all, and of records with any; limits leave one record's room."""
    count = Counter(code for each in told for code in each.codes)
    room = 100.0 / len(told)
    found = [
        Figure(
            what=f"plain motors told {code}",
            value=100.0 * number / len(told),
            unit="%",
            at_most=max(EACH, room),
        )
        for code, number in count.most_common()
    ]
    accused = sum(bool(each.codes) for each in told)
    whole = Figure(
        what=f"plain motors told a cause that isn't there, of {len(told)}",
        value=100.0 * accused / len(told),
        unit="%",
        at_most=max(ALL, room),
    )
    verdicts = Counter(each.verdict for each in told)
    seconds = sorted(each.seconds for each in told)
    print(", ".join(f"{name} {number}" for name, number in verdicts.most_common()))
    print(f"processor time: median {seconds[len(seconds) // 2]:.2g} s, longest {seconds[-1]:.2g} s")
    return [whole, *found]


def _real(judged: Sequence) -> list[Figure]:
    """The number of real recordings with a false cause, and of those with a known cause, how many get it."""
    if not judged:
        what = "real recordings: not run, they are absent (SERVOBENCH_REAL_DATA names their folder)"
        return [Figure(what=what, value=float("nan"))]
    false = Counter(code for each in judged for code in each.false)
    with_cause = [each for each in judged if each.has_cause]
    found = [
        Figure(what=f"real recordings told {code} falsely", value=float(number), unit="", at_most=0.0)
        for code, number in false.most_common()
    ]
    return [
        Figure(
            what=f"real recordings told a cause that isn't theirs, of {len(judged)}",
            value=100.0 * sum(bool(each.false) for each in judged) / len(judged),
            unit="%",
            at_most=ALL,
        ),
        *found,
        Figure(
            what=f"real recordings told the cause that they have, of {len(with_cause)}",
            value=100.0 * sum(each.named for each in with_cause) / max(len(with_cause), 1),
            unit="%",
            at_least=100.0,
        ),
    ]


def command(words: Sequence[str]) -> int:
    """Measure and print; returns the exit status."""
    from figures import shown

    parser = argparse.ArgumentParser(description="How often a cause is named that isn't there.")
    parser.add_argument("--plain", type=int, default=PLAIN, help="how many plain motors")
    parser.add_argument("--first", type=int, default=0, help="the first plain motor's number")
    parser.add_argument("--real", action="store_true", help="the real recordings alone")
    asked = parser.parse_args(words)
    return shown(main(0 if asked.real else asked.plain, asked.first, asked.real or asked.first == 0))


if __name__ == "__main__":
    sys.exit(command(sys.argv[1:]))
