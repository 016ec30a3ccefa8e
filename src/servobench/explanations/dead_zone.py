"""Small inputs that don't act, whether the motor stands or turns: an amplifier's dead zone, which isn't friction."""

from __future__ import annotations

import numpy as np

from servobench.channels import Array
from servobench.explanations.base import EXPLANATIONS, Case, Explained
from servobench.finding import warning

_WIDTHS = (0.02, 0.035, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4)


def _dead_zone(case: Case) -> Explained | None:
    """The best width of a zone around zero in which the input has no effect."""
    largest = max(float(np.abs(each.u).max()) for each in case.motions)
    tried = [
        (case.with_input(lambda m, width=width: without_zone(m.u, width)), width)  # type: ignore[misc]
        for width in (part * largest for part in _WIDTHS)
    ]
    found, width = min(tried, key=lambda each: each[0].misfit)
    unit = case.motions[0].data.input_unit
    sentence = (
        f"Inputs within about ±{width:.2g} {unit} don't act, even on a motor that turns: that is a dead zone of the "
        "amplifier, and not friction, which brakes. Record the voltage behind the amplifier, or take the zone off the input "
        "first."
    )
    return Explained(
        finding=warning("dead-zone", sentence, parameters=("gain", "coulomb_voltage")),
        misfit=found.misfit,
        chosen=1,
    )


def without_zone(u: Array, width: float) -> Array:
    """Return what an amplifier with a dead zone puts out (N,): u (N,) moved towards zero by its width, in the unit of u."""
    return u - np.clip(u, -width, width)


EXPLANATIONS.member("dead_zone")(_dead_zone)
