"""The stability left open by the data: is the verdict the same for all parameters within their intervals?

Tried are the corners of the box of the 95 % intervals and parameters drawn from what the fit says of them, correlations and all.
A verdict that holds for all of these is stated with what the draws can tell: of n draws without an exception, less than 3/n of
the probability is left for one, at 95 % (Hanley and Lippman-Hand, JAMA 249, 1983).
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from servobench.core.channels import Array
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import percent
from servobench.identification.estimators.base import Fit
from servobench.identification.models.base import Model, Output
from servobench.identification.uncertainty.propagation import draws, sample_time_of
from servobench.systems.interop import as_controller
from servobench.systems.margins import series
from servobench.systems.sampled_loop import sampled_series
from servobench.systems.stability.nyquist import closed_loop
from servobench.systems.stability.sampled import closed_sampled_loop
from servobench.systems.stability.verdict import StabilityVerdict, stability
from servobench.systems.transfer_function import TransferFunction

_DRAWS = 600
_MOST_CORNERS = 1024  # of ten parameters; of more the corners of the ten that are least known


@dataclass(frozen=True, kw_only=True)
class OverIntervals:
    """The verdict over the parameters' intervals.

    `verdict` is that of the estimate, `everywhere` whether it is that of all corners of the 95 % intervals and of all draws.
    `corners_alike` of the `corners` and the part `share` of the `draws` have the estimate's verdict; `undetermined` are
    parameters that the data don't determine, which were left where they are. `sentence` says all of it.
    """

    verdict: StabilityVerdict
    everywhere: bool
    share: float
    corners: int
    corners_alike: int
    draws: int
    undetermined: tuple[str, ...]
    sentence: str


def stability_over_intervals(fit: Fit, around: Output = "speed") -> OverIntervals:
    """Return whether the motor itself, from the input to position or speed, has one verdict over the intervals."""
    return _judge(fit, lambda model: stability(model.transfer_function(around)).verdict, "the motor")


def loop_over_intervals(
    fit: Fit,
    controller: TransferFunction | Any = None,
    around: Output = "position",
    *,
    sample_time: float | None = None,
) -> OverIntervals:
    """Return whether a loop around the motor, as it runs at ticks, has one verdict for all parameters in their intervals.

    `controller` is C, from the error to the input: a `TransferFunction`, a python-control system, or None for unit feedback. It
    runs every `sample_time` [s], without one at that of the data, as in `uncertainty.propagation.loop_margins`. A
    negative delay, which an estimate may have by chance, counts as none. Raises `UsageError` for a sample time that isn't above
    zero.
    """
    h = sample_time_of(fit) if sample_time is None else sample_time
    feedback = as_controller(controller)

    def verdict(model: Model) -> StabilityVerdict:
        return closed_sampled_loop(sampled_series(feedback, model.transfer_function(around), h)).verdict

    return _judge(fit, verdict, "the closed loop")


def continuous_loop_over_intervals(
    fit: Fit, controller: TransferFunction | Any = None, around: Output = "position"
) -> OverIntervals:
    """Return the same of the continuous loop, without ticks. Raises `UsageError` as `closed_loop` does."""
    feedback = as_controller(controller)

    def verdict(model: Model) -> StabilityVerdict:
        loop = series(feedback, model.transfer_function(around))
        return closed_loop(replace(loop, delay=max(loop.delay, 0.0))).verdict

    return _judge(fit, verdict, "the closed loop")


def _judge(fit: Fit, verdict: Callable[[Model], StabilityVerdict], what: str) -> OverIntervals:
    own = verdict(fit.model)
    thetas, _ = draws(fit, _DRAWS)
    corners = list(_corners(fit))
    of_draws = Counter(verdict(replace(fit.model, theta=theta)) for theta in thetas)
    of_corners = Counter(verdict(replace(fit.model, theta=theta)) for theta in corners)
    sd = np.sqrt(np.diag(fit.covariance))
    unknown = tuple(name for name, s in zip(fit.model.names, sd, strict=True) if not np.isfinite(s))
    alike, share = of_corners[own], of_draws[own] / len(thetas)
    everywhere = alike == len(corners) and of_draws[own] == len(thetas)
    return OverIntervals(
        verdict=own,
        everywhere=everywhere,
        share=share,
        corners=len(corners),
        corners_alike=alike,
        draws=len(thetas),
        undetermined=unknown,
        sentence=_sentence(
            what, own, everywhere, alike, len(corners), share, len(thetas), _list(fit, unknown)
        ),
    )


def _corners(fit: Fit) -> Iterable[Array]:
    """The corners of the box of the 95 % intervals, within the parameters' bounds."""
    lower, upper = fit.model.structure.bounds([fit.model.data])
    ends = [fit.estimates[name].interval for name in fit.model.names]
    theta = fit.model.theta
    known = [n for n, (low, high) in enumerate(ends) if np.isfinite([low, high]).all() and low < high]
    known.sort(key=lambda n: -(ends[n][1] - ends[n][0]) / max(abs(float(theta[n])), 1e-300))
    known = known[: int(np.log2(_MOST_CORNERS))]
    for sides in itertools.product((0, 1), repeat=len(known)):
        corner = theta.copy()
        for n, side in zip(known, sides, strict=True):
            corner[n] = ends[n][side]
        yield np.clip(corner, lower, upper)


def _sentence(
    what: str,
    verdict: str,
    everywhere: bool,
    alike: int,
    corners: int,
    share: float,
    draw_count: int,
    unknown: str,
) -> str:
    if everywhere:
        sentence = (
            f"Over the 95 % intervals {what} is {verdict} everywhere: with each parameter at either end of its interval, in all "
            f"{corners} combinations, and for {draw_count} sets of parameters drawn at random from what the fit leaves open."
        )
    else:
        sentence = (
            f"At the estimate {what} is {verdict}, but the data leave it open: the same holds for {percent(100 * share)} % of "
            f"{draw_count} sets of parameters drawn at random from the fit, and for {alike} of the {corners} combinations of the "
            "ends of their 95 % intervals."
        )
    if unknown:
        sentence += f" Held at their estimates, as the data don't determine them: {unknown}."
    return sentence


def _list(fit: Fit, names: Sequence[str]) -> str:
    return ", ".join(parameter_in_words(name, fit.unit(name)) for name in names)
