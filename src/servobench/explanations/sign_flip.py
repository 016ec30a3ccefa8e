"""A sign that turns round in the middle of a record: an encoder's or an amplifier's wires changed places, or a setting did."""

from __future__ import annotations

import numpy as np

from servobench.explanations.base import EXPLANATIONS, Case, Explained
from servobench.explanations.equation import Motion
from servobench.finding import refusal

_PLACES = 40


def _sign_flip(case: Case) -> Explained | None:
    """The best time from which on the input acts the other way round."""
    best, least, who = None, np.inf, ""
    for n, each in enumerate(case.motions):
        for at in each.t[0] + np.arange(2, _PLACES - 1) / _PLACES * (each.t[-1] - each.t[0]):
            tried = case.with_input(lambda m, n=n, at=at: _turned(m, at) if m is case.motions[n] else m.u)  # type: ignore[misc]
            if tried.misfit < least:
                best, least, who = float(at), tried.misfit, each.data.name
    if best is None:
        return None
    sentence = (
        f"{who}: from about {best:.3g} s on the motor answers the other way round: the sign of the input or of the output "
        "changed in the middle of the record (a cable, an encoder's direction, a setting). Cut the file there, or turn one "
        "part's sign."
    )
    return Explained(finding=refusal("sign-flips", sentence, parameters=("gain",)), misfit=least, chosen=1)


def _turned(m: Motion, at: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.where(m.t < at, m.u, -m.u)


EXPLANATIONS.member("sign_flip")(_sign_flip)
