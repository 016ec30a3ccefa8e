"""Small departures that every motor may have and no model of constant parameters does: lines of the budget.

- *A winding that warms up.* The resistance of copper grows by 0.4 % a kelvin. A resistance that is larger by s takes s times the
  voltage u - ω/K that drives the current, so friction costs more of the input and the time constant grows, steadily over the
  record. Where a motor turns one way, at few levels, that looks like another gain. The parameters are those half way through.
- *A dead band.* An amplifier, or the software before it, passes nothing until the input is large enough, and then that much less.
  While the shaft turns as the input says, friction costs as much; where the input has changed its sign and the shaft hasn't, it
  doesn't. Under one size of input the gain is that between its levels, dead band included.
- *A driver that lets go.* Under next to no input many drivers leave the motor open, so that its winding, which lost ω/K of the
  input, brakes it no longer; the bearings still do, by about a tenth of that. Where a run-down alone tells gain and friction
  apart, that makes all the difference.
- *Play in a gear.* The output rests until the gap is used up, then follows. In a record of a few degrees of travel that looks
  like less friction and less gain.
- *A shaft that twists.* Between a rotor and its load any shaft is a spring. Well below the resonance ω_r an encoder on the rotor
  is ahead of a rigid shaft, one on the load is behind it, by up to the acceleration over ω_r². Under steps that looks like
  another time constant, or like a little friction. A resonance below 100 Hz, or below 30 times the motor's own rate, shows.

How large they are is as of any term that a motor may have (`possible_term`). Friction near rest, whose effect is no smooth one,
has its own line (`friction_near_rest`).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from servobench.core.channels import Array
from servobench.core.rounding import plain as number
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.budget import Contribution
from servobench.identification.models.level import HARDLY_CONDUCTS
from servobench.identification.uncertainty.possible_term import possible_covariance
from servobench.identification.uncertainty.score_test import SMALL, Motion, ScoreTest, Term

_WARMER = 0.1  # of the resistance, over a record: 25 K
_PLAY = float(np.deg2rad(0.5))  # rad, of a gear
_BAND = 0.05  # of the largest input: the widest dead band to either side
_TYPICAL_BAND = 0.03  # of the largest input: whose effect counts, as that isn't in proportion to the width
_ONE_SIZE = 0.03  # of the largest input: sizes that lie nearer than that are one
_FREE = 0.9  # of what the winding brakes a motor with is missing where a driver lets go of it; the bearings still brake
_TYPICAL = 0.5  # of the largest play, for the same reason
_RESONANCE = 2 * np.pi * 100.0  # rad/s: a lower one shows as an oscillation
_ABOVE = 30.0  # over the time constant: a resonance is as much faster than a motor, for it to be one mass in the main


def with_small_departures(fit: Fit) -> Fit:
    """Return the fit with lines of its budget: a warmer winding, a dead band, a driver that lets go, play, a shaft that twists.

    The same where the model isn't first order, or nothing is left over.
    """
    largest = max(float(np.abs(record.data.u).max(initial=0.0)) for record in fit.records)
    known = {"gain", "time_constant"} <= set(fit.model.names) and fit.model["gain"] != 0
    if not (known and largest > 0 and np.isfinite(fit.residual_sd) and fit.residual_sd > 0):
        return fit
    test = ScoreTest(fit, largest)
    for forms, source, reason in _departures(test, largest):
        finite = all(np.isfinite(column).all() for column in forms)
        added = possible_covariance(test, *forms) if finite else np.zeros((0, 0))
        if added.any():
            fit = fit.widen(Contribution(source=source, covariance=added, reason=reason))
    return fit


def _departures(test: ScoreTest, largest: float) -> Iterator[tuple[tuple[Array, ...], str, str]]:
    """The largest that each departure may be in the innovations, a column (N,) for each of its forms; its source and reason."""
    fit = test.fit
    gain, tau = fit.model["gain"], fit.model["time_constant"]
    warming = _WARMER / SMALL * _columns(test, _warming(gain, largest))
    yield (warming,), "a motor that warms up", "the winding may become warmer by 25 K within the record"
    if _sizes_differ(fit, largest):
        lost = _BAND / SMALL * _columns(test, _dead_band(fit))
        yield (lost,), "a dead band", "the amplifier may lose up to 5 % of the largest input near zero"
    if any(np.any(np.abs(record.data.u) <= HARDLY_CONDUCTS * largest) for record in fit.records):
        let_go = _FREE / SMALL * _columns(test, _free_wheel(gain, largest))
        reason = "the driver may let go of the motor under next to no input, and not brake it"
        yield (let_go,), "a driver that lets go", reason
    if all(record.data.position_unit == "rad" for record in fit.records):
        played = _columns(test, _PLAYING) / _TYPICAL
        yield (played,), "play", "a gear may have play of up to half a degree"
    if tau > 0:
        resonance = max(_RESONANCE, _ABOVE / tau)
        twisted = _columns(test, _TWISTING) / resonance**2
        hertz = number(resonance / (2 * np.pi), 2)
        reason = f"the shaft may twist, with a resonance at {hertz} Hz or higher"
        yield (twisted, -twisted), "a shaft that twists", reason


def _columns(test: ScoreTest, term: Term) -> Array:
    """The innovations of all records due to a term (N,)."""
    return np.asarray(np.concatenate([run.columns([term])[0][:, 0] for run in test.runs]), dtype=np.float64)


def _warming(gain: float, largest: float) -> Term:
    """The input taken by a resistance that doubles within a record, in parts of the largest input [input unit]."""

    def drop(motion: Motion) -> tuple[Array, ...]:
        driving = motion.input - motion.fastest / (gain * largest) * motion.speed
        return (-0.5 * motion.gone * driving,)

    return Term(code="motor-changes", name="a motor that warms up", sentence="", to_input=drop)


def _free_wheel(gain: float, largest: float) -> Term:
    """The input in place of the winding's braking while there is next to none, in parts of the largest [input unit]."""

    def open_winding(motion: Motion) -> tuple[Array, ...]:
        open_circuit = np.abs(motion.input) <= HARDLY_CONDUCTS
        return (np.where(open_circuit, motion.fastest / (gain * largest) * motion.speed, 0.0),)

    return Term(code="coasts", name="a driver that lets go", sentence="", to_input=open_winding)


def _behind_a_gap(motion: Motion) -> tuple[Array, ...]:
    """The position due to typical play if the record begins with the gap closed: nothing until the shaft reverses."""
    from servobench.identification.models.play import behind_play

    half = 0.5 * _TYPICAL * _PLAY
    sense = np.sign(motion.speed[np.flatnonzero(motion.speed)[:1]]).sum()
    return (behind_play(motion.position, half, motion.position[0] - sense * half) - motion.position,)


def _sizes_differ(fit: Fit, largest: float) -> bool:
    """Whether the input has several sizes other than zero: of one, the gain is that between its levels, dead band included."""
    sizes = np.abs(np.concatenate([record.data.u for record in fit.records])) / largest
    return bool(((sizes > 0.0) & (sizes < 1.0 - _ONE_SIZE)).any())


def _dead_band(fit: Fit) -> Term:
    """The input taken by a dead band, in parts of its width, beyond what a Coulomb voltage as large takes where there is one."""
    friction = float(np.sign(fit.model["gain"])) if "coulomb_voltage" in fit.model.names else 0.0

    def loss(motion: Motion) -> tuple[Array, ...]:
        band = -np.clip(motion.input / _TYPICAL_BAND, -1.0, 1.0)
        return (band + friction * np.sign(motion.speed),)

    return Term(code="dead-zone", name="a dead band", sentence="", to_input=loss)


_TWISTING = Term(
    code="resonance",
    name="a shaft that twists",
    sentence="",
    to_output=lambda motion: (motion.acceleration,),
)
_PLAYING = Term(code="backlash", name="play", sentence="", to_output=_behind_a_gap)
