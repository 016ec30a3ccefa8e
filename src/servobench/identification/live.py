"""A motor's estimate while rows still come: what the panel shows beside its scopes, and `watch` in the terminal.

It is `Recursive` with the words around it: units, 95 % intervals, whether that is enough, and what keeps it from being enough.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from servobench.core.channels import Array
from servobench.core.rounding import TWO_SIDED
from servobench.identification.estimators.recursion.motion import Samples
from servobench.identification.estimators.recursion.start import Setting
from servobench.identification.estimators.recursive import Recursive
from servobench.identification.models.kernels import COULOMB, DELAY, OFFSET

_MORE = 2.0  # times too wide: intervals narrow with the root of the time, so four times as long would do
_COLUMNS = {
    "gain": 0,
    "time_constant": 1,
    "coulomb_voltage": COULOMB,
    "offset_voltage": OFFSET,
    "delay": DELAY,
}

MOTION = "needs motion"
FASTER = "needs a faster change of speed"
ANOTHER_SPEED = "needs another speed, or coasting to standstill"
BOTH_WAYS = "needs both directions"
LONGER = "needs more of the same motion"


class LiveEstimate:
    """Follows a motor as `setting` says, and says how well its parameters are known.

    `wish` are half-widths of 95 % intervals over the values, by name, such as `stopping_rule.parse_wish` returns. The units are
    those of the output, an angle in rad or a path in m, and of the input.
    """

    def __init__(
        self,
        setting: Setting,
        wish: Mapping[str, float] | None = None,
        output_unit: str = "rad",
        input_unit: str = "V",
    ) -> None:
        self._recursive = Recursive(setting)
        self.wish = dict(wish or {})
        self._units = {
            "gain": f"{output_unit}/(s·{input_unit})",
            "time_constant": "s",
            "coulomb_voltage": input_unit,
            "offset_voltage": input_unit,
            "delay": "s",
        }

    @property
    def samples(self) -> int:
        """The number of samples taken."""
        return self._recursive.samples

    @property
    def behind(self) -> int:
        """The number of the last samples whose residual will be known later; see `Recursive`."""
        return self._recursive.behind

    def take(self, samples: Samples) -> Array:
        """Take samples, and return the residuals (N,) that have become known; see `Recursive.take_samples`."""
        return self._recursive.take_samples(samples)

    def start_again(self, input_before: float | None = None) -> None:
        """Say that the next sample doesn't follow the last one; see `Recursive.start_again`."""
        self._recursive.start_again(input_before)

    def look_again(self) -> None:
        """Look at all samples so far now, without waiting for more of them: there will be none."""
        self._recursive.move_reference()

    def message(self, delay_sd: float = 0.0) -> dict[str, Any]:
        """Return the `live` message: the parameters with their 95 % intervals, the whiteness light, and whether it is enough.

        `delay_sd` is the standard deviation that the delay has beside that of the estimate [s].
        """
        estimates, white = self._recursive.estimate(), self._recursive.white
        if "delay" in estimates:
            value, sd = estimates["delay"]
            estimates["delay"] = value, math.hypot(sd, delay_sd)
        return {
            "kind": "live",
            "parameters": {
                name: {
                    "value": value,
                    "interval": [value - TWO_SIDED * sd, value + TWO_SIDED * sd],
                    "unit": self._units[name],
                }
                for name, (value, sd) in estimates.items()
            },
            "white": white,
            "enough": white is not False and self._is_reached(estimates),
            "samples": self._recursive.samples,
        }

    def missing_motions(self) -> tuple[str, ...]:
        """Return which motions would tell what is wished for, as the covariance says it; nothing where that is known already.

        A parameter that is nearly known needs more of the same. Where the gain would be known if friction or offset were, the
        missing motion is the one that tells these apart; a time constant that isn't known needs changes of speed that are fast
        beside it.
        """
        known = self._knowledge()
        if known is None:
            return (LONGER,) if self.samples else ()
        reference, covariance = known
        if not np.isfinite(covariance[0, 0]):
            return (MOTION,)
        motions = [
            _motion_for(name, share, reference, covariance)
            for name, share in self.wish.items()
            if TWO_SIDED * _sd(covariance, _COLUMNS[name]) > share * abs(reference[_COLUMNS[name]])
        ]
        return tuple(dict.fromkeys(motions))

    @property
    def turned_one_way(self) -> bool:
        """Whether the motor has turned one way only, so that friction and offset are known together and not each."""
        estimates = self._recursive.estimate()
        return bool(estimates) and "offset_voltage" not in estimates

    def _knowledge(self) -> tuple[Array, Array] | None:
        """A reference (7,) and its covariance (7, 7), of the estimate or of what was too little for one; None before a look."""
        if self._recursive.uninformed is not None:
            return self._recursive.uninformed.reference, self._recursive.uninformed.covariance
        estimates, covariance = self._recursive.estimate(), self._recursive.covariance
        if not estimates or covariance is None:
            return None
        reference, whole = np.zeros(7), np.zeros((7, 7))
        at = [_COLUMNS[name] for name in estimates]
        reference[at] = [value for value, _ in estimates.values()]
        whole[np.ix_(at, at)] = covariance
        return reference, whole

    def _is_reached(self, estimates: Mapping[str, tuple[float, float]]) -> bool:
        """Whether there is a wish, and each interval wished for is narrow enough."""
        return bool(self.wish) and all(
            name in estimates and TWO_SIDED * estimates[name][1] <= share * abs(estimates[name][0])
            for name, share in self.wish.items()
        )


def _motion_for(name: str, share: float, reference: Array, covariance: Array) -> str:
    """The motion that a parameter of too wide an interval lacks."""
    at = _COLUMNS[name]
    enough = share * abs(reference[at]) / TWO_SIDED
    if _sd(covariance, at) <= _MORE * enough:
        return LONGER
    if name == "time_constant":
        return FASTER
    for other, motion in ((COULOMB, ANOTHER_SPEED), (OFFSET, BOTH_WAYS), (1, FASTER)):
        if _sd_given(covariance, at, other) <= _MORE * enough:
            return motion
    return MOTION


def _sd(covariance: Array, at: int) -> float:
    return float(np.sqrt(covariance[at, at]))


def _sd_given(covariance: Array, at: int, other: int) -> float:
    """The standard deviation that a parameter would have if another one were known: the square root of its Schur complement."""
    if not 0 < covariance[other, other] < np.inf:
        return _sd(covariance, at)
    left = covariance[at, at] - covariance[at, other] ** 2 / covariance[other, other]
    return float(np.sqrt(max(left, 0.0)))
