"""Does identification predict real motors at least as well as a plain least-squares fit with friction and a delay?

    python bench/held_out.py                    all recordings: a line each
    python bench/held_out.py --motor fra233     the recordings of one motor

Each recording is cut twice. *In turn*: the stretches or input levels that `identify` leaves out for its own validation; the plain
fit gets the same rest and predicts the same part. *Second half*: both are given the first half alone, the choice of the structure
included. Of what is predicted either fits the start state only. Where identification refuses to answer from the first half, it
predicts nothing, and nothing is compared: those are counted by themselves. The recordings are in `real_parts/recordings.py`.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from figures import Figure, shown

from servobench.identification.identify import identify
from servobench.identification.result import Result
from servobench.identification.trust.held_out import cuts_for_validation
from servobench.recordings.measurement.dataset import Dataset

SMALLEST = ("undcmotor",)
WORSE = 0.5  # points
_TRANSIENT = 0.1  # of the input's range: a half in which it changes by less tells nothing of a motor's motion


@dataclass(frozen=True, kw_only=True)
class Compared:
    """The predictions of data that weren't fitted, by identification and by a plain fit, both in %."""

    motor: str
    name: str
    cut: str
    ours: float
    plain: float
    structure: str
    refused: bool = False

    @property
    def worse(self) -> float:
        """The points by which identification is worse."""
        return self.plain - self.ours


def compared(motors: Sequence[str], show: Callable[[Compared], None]) -> list[Compared]:
    """Return the comparison of each cut of each recording that can be cut; `show` sees each as soon as it's there."""
    from real_parts.recordings import usable

    found = []
    for each in usable():
        if motors and each.motor not in motors:
            continue
        data = each.dataset()
        for cut, pair in (("in turn", _in_turn(identify(data))), ("second half", _second_half(data))):
            if pair is not None:
                found.append(Compared(motor=each.motor, name=each.name, cut=cut, **pair))
                show(found[-1])
    return found


def _in_turn(result: Result) -> dict[str, Any] | None:
    """Parts left out in turn, those that the result itself was tried on."""
    from real_parts.plain import fitted, residuals, share

    if result.validation is None or result.fit is None:
        return None
    tried = {record.name for record in result.validation.records}
    left = []
    for part in cuts_for_validation(result.data)[1]:
        if part.name in tried:
            left += residuals(fitted(part.rest), part.held)
    return {"ours": result.validation.fit_percent, "plain": share(left), "structure": result.fit.structure}


def _second_half(data: Dataset) -> dict[str, Any] | None:
    """The second half, predicted from the first."""
    from real_parts.plain import fitted, residuals, share

    start, end = float(data.t_output[0]), float(data.t_output[-1])
    middle = 0.5 * (start + end)
    first, rest = data.part(start, middle), data.part(middle, end + data.sample_time)
    whole = np.ptp(np.append(data.u, data.input_before))
    if min(np.ptp(half.u) for half in (first, rest)) <= _TRANSIENT * whole:
        return None
    result = identify(first, validate_on=[rest])
    if result.validation is None or result.fit is None:
        return {"ours": float("nan"), "plain": share(residuals(fitted([first]), [rest])), "structure": "none"}
    return {
        "ours": result.validation.fit_percent,
        "plain": share(residuals(fitted([first]), [rest])),
        "structure": result.fit.structure,
        "refused": result.verdict == "refused",
    }


def main(motors: Sequence[str] = (), show: Callable[[Compared], None] = lambda one: None) -> list[Figure]:
    """Return how often, and by how much at most, identification predicts worse than a plain fit (some minutes)."""
    from real_parts.recordings import FOLDER

    if not FOLDER.is_dir():
        what = "held-out prediction: not run, the recordings are absent (SERVOBENCH_REAL_DATA names their folder)"
        return [Figure(what=what, value=float("nan"))]
    found = compared(motors, show)
    return [figure for cut in ("in turn", "second half") for figure in _figures(found, cut)]


def smallest() -> list[Figure]:
    """Return the same figures of one motor alone."""
    return main(SMALLEST)


def _figures(found: Iterable[Compared], cut: str) -> list[Figure]:
    tried = [one for one in found if one.cut == cut]
    worse = np.array([one.worse for one in tried if not one.refused])
    named = f"of {len(worse)} real recordings predicted, {cut}"
    return [
        Figure(what=f"{cut}: refused, of {len(tried)}", value=len(tried) - len(worse)),
        Figure(
            what=f"{named}: worse than a plain fit by more than {WORSE} points",
            value=float(np.sum(~(worse <= WORSE))),
            goal="0",
        ),
        Figure(
            what=f"{named}: points worse than a plain fit",
            value=float(np.median(worse)),
            half=(float(np.quantile(worse, 0.25)), float(np.quantile(worse, 0.75))),
        ),
    ]


def command(words: Sequence[str]) -> int:
    """Compare each recording, print a line each, and return the exit status."""
    parser = argparse.ArgumentParser(description="Held-out prediction beside a plain least-squares fit.")
    parser.add_argument("--motor", action="append", default=[], help="only this motor; may be repeated")

    def show(one: Compared) -> None:
        mark = "  refused" if one.refused else "" if one.worse <= WORSE else f"  WORSE by {one.worse:.2f}"
        print(
            f"{one.name:60} {one.cut:12} {one.ours:8.2f} %  plain {one.plain:8.2f} %  {one.structure}{mark}",
            flush=True,
        )

    return shown(main(parser.parse_args(words).motor, show))


if __name__ == "__main__":
    sys.exit(command(sys.argv[1:]))
