"""Small departures that every motor may have and no model of constant parameters does: lines of the budget.

- *A winding that warms up.* The resistance of copper grows by 0.4 % a kelvin. A resistance that is larger by s takes s times the
  voltage u - ω/K that drives the current, so friction costs more of the input and the time constant grows, steadily over the
  record. Where a motor turns one way, at few levels, that looks like another gain. The parameters are those half way through.
- *Play in a gear.* The output rests until the gap is used up, then follows. In a record of a few degrees of travel that looks
  like less friction and less gain.

How large they are is as of any term that a motor may have (`possible_term`). Friction near rest, whose effect is no smooth one,
has its own line (`friction_near_rest`).
"""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.budget import Contribution
from servobench.identification.uncertainty.possible_term import possible_covariance
from servobench.identification.uncertainty.score_test import SMALL, Motion, ScoreTest, Term

_WARMER = 0.1  # of the resistance, over a record: 25 K
_PLAY = float(np.deg2rad(0.5))  # rad, of a gear
_TYPICAL = 0.5  # of that: what it does isn't in proportion to its size, and counts as one in the middle


def with_small_departures(fit: Fit) -> Fit:
    """Return the fit with lines of its budget for a winding that warms up, by up to 25 K a record, and for play in a gear.

    The same where the model isn't first order, or nothing is left over.
    """
    largest = max(float(np.abs(record.data.u).max(initial=0.0)) for record in fit.records)
    known = {"gain", "time_constant"} <= set(fit.model.names) and fit.model["gain"] != 0
    if not (known and largest > 0 and np.isfinite(fit.residual_sd) and fit.residual_sd > 0):
        return fit
    test = ScoreTest(fit, largest)
    warming = _WARMER / SMALL * _columns(test, _warming(fit.model["gain"], largest))
    lines = [(warming, "a motor that warms up", "the winding may become warmer by 25 K within the record")]
    if all(record.data.position_unit == "rad" for record in fit.records):
        played = _columns(test, _PLAYING) / _TYPICAL
        lines.append((played, "play", "a gear may have play of up to half a degree"))
    for column, source, reason in lines:
        added = possible_covariance(test, column) if np.isfinite(column).all() else np.zeros((0, 0))
        if added.any():
            fit = fit.widen(Contribution(source=source, covariance=added, reason=reason))
    return fit


def _columns(test: ScoreTest, term: Term) -> Array:
    """The innovations of all records due to a term (N,)."""
    return np.asarray(np.concatenate([run.columns([term])[0][:, 0] for run in test.runs]), dtype=np.float64)


def _warming(gain: float, largest: float) -> Term:
    """The input taken by a resistance that doubles within a record, in parts of the largest input [input unit]."""

    def drop(motion: Motion) -> tuple[Array, ...]:
        driving = motion.input - motion.fastest / (gain * largest) * motion.speed
        return (-0.5 * motion.gone * driving,)

    return Term(code="motor-changes", name="a motor that warms up", sentence="", to_input=drop)


def _behind_a_gap(motion: Motion) -> tuple[Array, ...]:
    """The position due to typical play if the record begins with the gap closed: nothing until the shaft reverses."""
    from servobench.identification.models.play import behind_play

    half = 0.5 * _TYPICAL * _PLAY
    sense = np.sign(motion.speed[np.flatnonzero(motion.speed)[:1]]).sum()
    return (behind_play(motion.position, half, motion.position[0] - sense * half) - motion.position,)


_PLAYING = Term(code="backlash", name="play", sentence="", to_output=_behind_a_gap)
