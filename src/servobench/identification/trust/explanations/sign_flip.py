"""A sign that changes in the middle of a record: swapped wires of an encoder or an amplifier, or a changed setting."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import refusal
from servobench.identification.trust.explanations.base import EXPLANATIONS, Case
from servobench.identification.trust.explanations.cause import CauseFit
from servobench.identification.trust.explanations.equation import Motion, sweep_count
from servobench.recordings.measurement.dataset import Dataset

_PLACES = 40
_SWEPT = 1.0  # times through its range, before and after: an input that rests shows no sign


def _sign_flip(case: Case) -> CauseFit | None:
    """The best time from which on the input acts the other way round."""
    best, least, turned = None, np.inf, case.motions[0].data
    for n, each in enumerate(case.motions):
        along = each.sense * each.u
        for at in each.t[0] + np.arange(2, _PLACES - 1) / _PLACES * (each.t[-1] - each.t[0]):
            if min(sweep_count(each.u[each.t < at]), sweep_count(each.u[each.t >= at])) < _SWEPT:
                continue
            if float(along[each.t < at].sum()) * float(along[each.t >= at].sum()) >= 0:
                continue  # a motor follows its input in the mean: on both sides of a true flip, in different directions
            tried = case.with_input(lambda m, n=n, at=at: _turn(m, at) if m is case.motions[n] else m.u)  # type: ignore[misc]
            if tried.misfit < least:
                best, least, turned = float(at), tried.misfit, each.data
    if best is None:
        return None
    sentence = (
        f"{turned.name}: from about {best:.3g} s on the motor responds in the opposite direction: "
        "the sign of the input or the output changed in the middle of the record (a cable, an "
        "encoder's direction, a setting). Cut the file there, or change the sign of one part."
    )
    return CauseFit(
        finding=refusal("sign-flips", sentence, parameters=("gain",)),
        misfit=least,
        chosen=1,
        remedy=lambda data: _turn_back(data, best) if data is turned else data,
    )


def _turn_back(data: Dataset, at: float) -> Dataset:
    return replace(data, u=np.where(data.t_input < at, data.u, -data.u), reference=None)


def _turn(m: Motion, at: float) -> Array:
    return np.where(m.t < at, m.u, -m.u)


EXPLANATIONS.member("sign_flip")(_sign_flip)
