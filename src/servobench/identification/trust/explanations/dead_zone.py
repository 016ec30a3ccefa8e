"""Small inputs that don't act, whether the motor stands or turns: an amplifier's dead zone, which isn't friction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import warning
from servobench.core.rounding import with_unit
from servobench.identification.models.motion import smooth_speed
from servobench.identification.trust.explanations.base import EXPLANATIONS, Case
from servobench.identification.trust.explanations.cause import CauseFit
from servobench.identification.trust.explanations.equation import Motion, sweep_count
from servobench.identification.trust.explanations.steady_windows import steady_windows

_TURNING = 0.1  # of the top speed: a motor that turns, as friction alone lets none turn for long
_SWEPT = 2.0  # times through its range: over one ramp or step a zone looks like friction
_SEEN = 0.01  # of the samples have to show a turning motor under an input in the zone
_WIDTHS = (0.02, 0.035, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4)


def _dead_zone(case: Case) -> CauseFit | None:
    """The best width of a zone around zero in which the input has no effect."""
    largest = max(float(np.abs(each.u).max()) for each in case.motions)
    tried = [
        (case.with_input(lambda m, width=width: without_zone(m.u, width)), width)  # type: ignore[misc]
        for width in (part * largest for part in _WIDTHS)
    ]
    best_regression, width = min(tried, key=lambda each: each[0].misfit)
    if (
        max(sweep_count(each.u) for each in case.motions) < _SWEPT
        or _moving_share(case.motions, width) < _SEEN
    ):
        return None
    if _turns_evenly(case.motions, width, float(best_regression.coefficients[0])):
        return None
    unit = case.motions[0].data.input_unit
    sentence = (
        f"Inputs within about ±{with_unit(width, unit, 2)} have no effect, even while the motor turns: that is a dead zone of "
        "the amplifier, not friction, which would brake. Record the voltage behind the amplifier, or subtract the dead zone from "
        "the input first."
    )
    return CauseFit(
        finding=warning("dead-zone", sentence, parameters=("gain", "coulomb_voltage")),
        misfit=best_regression.misfit,
        chosen=1,
        remedy=lambda data: replace(data, u=without_zone(data.u, width), reference=None),
    )


def _moving_share(motions: Sequence[Motion], width: float) -> float:
    """The part of the samples in which the motor turns under an input in the zone, which isn't zero: what isn't friction's."""
    speeds = [np.abs(np.interp(m.t, m.data.t_output, smooth_speed(m.data))) for m in motions]
    top = max(float(np.percentile(speed, 99)) for speed in speeds)
    shown = [
        (np.abs(m.u) < width) & (m.u != 0) & (w > _TURNING * top)
        for m, w in zip(motions, speeds, strict=True)
    ]
    return float(np.mean(np.concatenate(shown)))


def _turns_evenly(motions: Sequence[Motion], width: float, time_constant: float) -> bool:
    """Whether the motor goes on at its speed under inputs in the zone for several time constants [s]: then they act."""
    speeds, least, largest = steady_windows(motions, time_constant).T
    top = max(float(np.percentile(np.abs(smooth_speed(each.data)), 99)) for each in motions)
    return bool(np.any((least > 0.0) & (largest < width) & (speeds > _TURNING * top)))


def without_zone(u: Array, width: float) -> Array:
    """Return what an amplifier with a dead zone puts out (N,): u (N,) moved towards zero by its width, in the unit of u."""
    return u - np.clip(u, -width, width)


EXPLANATIONS.member("dead_zone")(_dead_zone)
