"""Stability of a transfer function, from its poles, with the reason in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from servobench.transfer_function import TransferFunction

StabilityVerdict: TypeAlias = Literal["stable", "marginally stable", "unstable"]
_TOLERANCE = 1e-9  # a pole this close to the axis, relative to the largest pole, counts as on it


@dataclass(frozen=True, kw_only=True)
class StabilityReport:
    """The poles [1/s] and how many times each stands there; the verdict and its reasons.

    `bibo` says whether every bounded input gives a bounded output.
    """

    poles: tuple[complex, ...]
    multiplicities: tuple[int, ...]
    verdict: StabilityVerdict
    bibo: bool
    reasons: tuple[str, ...]


def stability(system: TransferFunction) -> StabilityReport:
    """Return whether a system is stable.

    Asymptotically stable, and BIBO stable, if every pole has a negative real part. Marginally stable if the rightmost
    poles are simple and on the imaginary axis: some bounded input, a constant for an integrator, then drives the output
    without bound. Unstable otherwise. A delay doesn't change any of this.
    """
    poles = system.poles
    scale = float(np.abs(poles).max(initial=0.0)) or 1.0
    distinct: list[complex] = []
    counts: list[int] = []
    for pole in poles:
        # A root of multiplicity m is found to the m-th root of the machine's precision.
        match = next((n for n, other in enumerate(distinct) if abs(pole - other) < 1e-6 * scale), None)
        if match is None:
            distinct.append(complex(pole))
            counts.append(1)
        else:
            counts[match] += 1
    reasons = tuple(_reason(pole, count, scale) for pole, count in zip(distinct, counts, strict=True))
    right = [p for p in distinct if p.real > _TOLERANCE * scale]
    axis = [(p, n) for p, n in zip(distinct, counts, strict=True) if abs(p.real) <= _TOLERANCE * scale]
    verdict: StabilityVerdict = "stable"
    if right or any(n > 1 for _, n in axis):
        verdict = "unstable"
    elif axis:
        verdict = "marginally stable"
    return StabilityReport(
        poles=tuple(distinct),
        multiplicities=tuple(counts),
        verdict=verdict,
        bibo=verdict == "stable",
        reasons=reasons,
    )


def _reason(pole: complex, count: int, scale: float) -> str:
    where = (
        f"{pole.real:.4g}" if abs(pole.imag) <= _TOLERANCE * scale else f"{pole.real:.4g} {pole.imag:+.4g}j"
    )
    times = {1: "", 2: ", twice"}.get(count, f", {count} times")
    if pole.real > _TOLERANCE * scale:
        return f"The pole at {where} 1/s{times} is in the right half-plane: its response grows without bound."
    if abs(pole.real) <= _TOLERANCE * scale:
        which = "0" if abs(pole.imag) <= _TOLERANCE * scale else f"±{abs(pole.imag):.4g}j"
        if count > 1:
            return f"The pole at {which} 1/s{times} is on the imaginary axis: its response grows without any input."
        kept = "keeps" if which == "0" else "oscillates without decay after"
        bounded = "a constant" if which == "0" else "a sinusoid of that frequency"
        return (
            f"The simple pole at {which} 1/s is on the imaginary axis: the output {kept} what it got, and {bounded} as input "
            "drives it without bound."
        )
    return f"The pole at {where} 1/s{times} is in the left half-plane: its response dies out with {1 / -pole.real:.4g} s."
