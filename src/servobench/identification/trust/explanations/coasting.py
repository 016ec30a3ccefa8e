"""A motor that slows down more slowly than it speeds up: a bridge that lets go of it where it should brake."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import warning
from servobench.identification.models.motion import smooth_speed
from servobench.identification.trust.explanations.base import EXPLANATIONS, Case
from servobench.identification.trust.explanations.cause import CauseFit
from servobench.identification.trust.explanations.equation import Motion, with_extra
from servobench.recordings.measurement.dataset import Dataset

_SLOWER = 1.5  # times the time constant: less is what friction and a supply that gives way make
_BOTH = 0.1  # of the rows have to speed up, and as many to slow down
ADVICE = "Let the driver brake (synchronous, slow decay), or use the model for speeding up alone."
"""What to do about a driver that lets go."""
PARAMETERS = ("time_constant", "delay", "coulomb_voltage")
"""What is wrong because of it."""


def _slow_braking(case: Case) -> CauseFit | None:
    """Whether (τ + Δ) ω' + ω = K (u - ...) makes the equation hold while the speed falls, and τ ω' + ω = K (u - ...) else."""
    if any(each.data.chain.linear for each in case.motions):
        return None
    masks = [_slows_down(each) for each in case.motions]
    share = float(np.mean(np.concatenate(masks)))
    if not _BOTH < share < 1 - _BOTH:
        return None
    slower = case.with_columns(
        [each.base[0][:, 0] * mask for each, mask in zip(case.motions, masks, strict=True)]
    )
    tau, gain, more = (float(slower.coefficients[at]) for at in (0, 1, 5))
    if not (tau > 0 and gain != 0 and tau + more > _SLOWER * tau):
        return None
    sentence = (
        f"The motor slows down more slowly than it speeds up, with a time constant of about {tau + more:.2g} s "
        f"instead of {tau:.2g} s: many bridges let go of a motor where they should brake it. {ADVICE}"
    )
    return CauseFit(
        finding=warning("coasts", sentence, parameters=PARAMETERS),
        structural=True,
        misfit=slower.misfit,
        chosen=1,
        remedy=lambda data: with_braking(data, more / gain, tau),
    )


def _slows_down(motion: Motion) -> Array:
    """Where the filtered speed falls, at the rows of the regression (R,)."""
    columns, speed = motion.base
    return np.asarray(-columns[:, 0] * speed < 0)


def with_braking(data: Dataset, factor: float, over: float) -> Dataset:
    """Return a record whose input brakes as much more while the speed falls as the motor lacks: `factor` (Δ/K) times ω'.

    `over` is the time [s] over which the acceleration is taken.
    """
    from scipy.ndimage import uniform_filter1d

    t = data.t_output
    samples = max(1, round(over / data.sample_time))
    speed = uniform_filter1d(smooth_speed(data), samples, mode="nearest")
    acceleration = np.gradient(speed, t)
    falls = np.where(acceleration * speed < 0, acceleration, 0.0)
    return with_extra(data, lambda at, u: -factor * np.interp(at, t, falls))


EXPLANATIONS.member("coasting")(_slow_braking)
