"""The sense in which a motor turns: against its input, or against its own gain."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, info, warning
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset

_NEARLY_ALL = 0.96  # of the sum without signs: the rest may be noise, or a shaft that shivers at rest
_EXPLAINED = 90.0  # percent of the output
_KNOWN = 0.1  # of its value
_BACK = 0.05  # of the way: what a position with noise may seem to come back


def _sense(fit: Fit) -> list[Finding]:
    if "gain" not in fit.model.names:
        return []
    gain = fit["gain"]
    # The sign of a gain that may be zero is unknown.
    signed = 2 * gain.sd < abs(gain.value)
    against = (signed or _starts_with_a_sign(fit)) and _runs_against_itself(fit)
    if against and not _is_inverted(fit):
        sentence = (
            f"The gain comes out {'negative' if gain.value < 0 else 'positive'}, although the motor turns "
            f"{'as' if gain.value < 0 else 'against what'} its input says all the time: the speed doesn't follow this input as a "
            "motor's would. The supply sags, the characteristic bends, or the column is another one. Record steps, each until "
            "the speed settles."
        )
        return [warning("gain-against-motion", sentence, parameters=("gain", "time_constant"))]
    if gain.value > 0 or not signed:
        return []
    return [
        info(
            "sign-negative",
            "A positive input turns the motor in the negative direction.",
            parameters=("gain",),
        )
    ]


def _runs_against_itself(fit: Fit) -> bool:
    """Whether each record has an input and a motion of one sign throughout, which together are the other sign than the gain's.

    Friction only takes from what an input does, so that no motor moves so unless something else drives it.
    """
    if any(name.startswith("gravity") for name in fit.model.names):
        return False
    senses = {_sign(record.data.u) * _motion_sign(record.data) for record in fit.records}
    return senses == {-np.sign(fit.model["gain"])}


def _is_inverted(fit: Fit) -> bool:
    """Whether the input is one that is largest at rest: a known constant, beyond all inputs, explains the motion with it."""
    if "coulomb_voltage" not in fit.model.names or fit.fit_percent < _EXPLAINED:
        return False
    most = fit["coulomb_voltage"]
    u = np.concatenate([record.data.u for record in fit.records])
    beyond = most.value * np.sign(u.sum()) >= _NEARLY_ALL * float(np.abs(u).max())
    return bool(beyond and most.sd < _KNOWN * abs(most.value))


def _starts_with_a_sign(fit: Fit) -> bool:
    """Whether K/τ, by which an input sets the shaft off, is known to be no zero."""
    names = fit.model.names
    if "time_constant" not in names or not fit.model["gain"] * fit.model["time_constant"]:
        return False
    at = [names.index(name) for name in ("gain", "time_constant")]
    slopes = np.array([1.0 / fit.model["gain"], -1.0 / fit.model["time_constant"]])  # of ln(K/τ)
    variance = float(slopes @ fit.covariance[np.ix_(at, at)] @ slopes)
    return 0.0 <= variance < 0.25


def _motion_sign(data: Dataset) -> float:
    """The sign of a motion that goes one way throughout, 0 of any other."""
    if data.kind == "speed":
        return _sign(data.y)
    sense = float(np.sign(data.y[-1] - data.y[0]))
    way = sense * data.y
    back = float(np.max(np.maximum.accumulate(way) - way))
    return sense if back <= _BACK * float(np.ptp(way)) else 0.0


def _sign(values: Array) -> float:
    """The sign of nearly all of some values (N,), 0 where either sign has its part."""
    total = float(np.abs(values).sum())
    part = float(values.sum()) / total if total > 0 else 0.0
    return float(np.sign(part)) if abs(part) >= _NEARLY_ALL else 0.0


DOUBTS.member("sense")(Doubt(codes=("sign-negative", "gain-against-motion"), about_fit=_sense))
