"""Two masses that swing against each other: an elastic shaft, belt or coupling between motor and load."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.finding import warning
from servobench.identification.models.motion import smooth_speed
from servobench.identification.trust.explanations.base import EXPLANATIONS, Case
from servobench.identification.trust.explanations.cause import CauseFit
from servobench.identification.trust.explanations.equation import (
    Motion,
    filter_bilinear,
    filter_time,
    may_be_any_shape,
    regression,
    rings,
)

_DAMPED = 0.3  # of critical damping: with more it hardly swings
_NYQUIST = 0.25  # of the sampling frequency: what swings faster can't be seen to swing
_PERIODS = 5  # in the record: what swings fewer times is anything slow
_ONE_TURN = 0.25  # of the turns in a second: an oscillation as near to them may come round with the shaft
_SAME_TURN = 0.05  # of them: no coupling swings so nearly once a turn by chance
_LAGS = 5  # of the filter, so that the fourth derivative is proper


def _resonance(case: Case) -> CauseFit | None:
    """Whether a pair of poles that swings, and a pair of zeros, beside the motor's own pole make the equation hold.

    τ ω' + ω + b₂ ω'' + b₃ ω''' = K (u - d u' + c₂ u'') and friction, as of two masses with a spring between them.
    """
    columns, speed = (
        np.concatenate(each) for each in zip(*map(resonance_columns, case.motions), strict=True)
    )
    without, full_regression = regression(columns[:, :5], speed), regression(columns, speed)
    tau, second, third = (float(full_regression.coefficients[k]) for k in (0, 5, 6))
    swinging = _swing_frequency(np.roots([third, second, tau, 1.0]).astype(np.complex128))
    if not any(rings(each.u) for each in case.motions):
        return None
    fastest = _NYQUIST / max(each.step for each in case.motions)
    slowest = _PERIODS / max(each.t[-1] - each.t[0] for each in case.motions)
    if swinging is None or not slowest < swinging < fastest or without.misfit == 0:
        return None
    if all(_comes_round(m, swinging) for m in case.motions):
        return None  # ripple of an encoder or a coupling, whose size the residual shows
    if may_be_any_shape(case.motions, full_regression.misfit / without.misfit):
        return None
    return CauseFit(
        finding=warning(
            "response-oscillates", _sentence(case, swinging), parameters=("gain", "time_constant")
        ),
        structural=True,
        misfit=case.plain.misfit * full_regression.misfit / without.misfit,
        chosen=4,
        structure="rational_3_2_integrator_delay",
    )


def _sentence(case: Case, swinging: float) -> str:
    turns = [_turns_per_second(m) for m in case.motions]
    if all(abs(swinging - each) <= _ONE_TURN * each for each in turns):
        return (
            f"The speed varies at about {swinging:.2g} Hz while the shaft makes {turns[0]:.2g} turns a second: either something "
            "comes round once a turn (an eccentric coupling or encoder, a bent shaft, gears), or two masses swing with a "
            "compliant coupling between them. At another speed only the former changes its frequency."
        )
    return (
        f"The shaft oscillates at about {swinging:.2g} Hz, as two masses do with a compliant "
        "coupling between them (a long shaft, a belt). A first-order motor is the wrong "
        "structure: stiffen the coupling, remove the load, or excite it well below that frequency."
    )


def _turns_per_second(m: Motion) -> float:
    """The usual speed of a shaft [1/s]; 0 where the output isn't an angle."""
    if m.data.position_unit != "rad":
        return 0.0
    return float(np.median(np.abs(smooth_speed(m.data)))) / (2 * np.pi)


def _comes_round(m: Motion, frequency: float) -> bool:
    """Whether the shaft makes as many turns a second as something swings [Hz], for half of the record at least."""
    turns = np.abs(smooth_speed(m.data)) / (2 * np.pi)
    return m.data.position_unit == "rad" and bool(
        np.mean(np.abs(turns - frequency) <= _SAME_TURN * frequency) >= 0.5
    )


def _swing_frequency(poles: NDArray[np.complex128]) -> float | None:
    """The frequency [Hz] of a stable pair of poles that is hardly damped; None where there is none."""
    pairs = poles[(poles.imag > 0) & (poles.real < 0)]
    swinging = [abs(pole) for pole in pairs if -pole.real < _DAMPED * abs(pole)]
    return float(swinging[0]) / (2 * np.pi) if swinging else None


def resonance_columns(m: Motion) -> tuple[Array, Array]:
    """Return the columns (R, 8) of τ, K, K d, K u_c, K u₀, b₂, b₃ and K c₂, and the speed (R,), behind filters of their own."""
    up = 1 if m.data.kind == "position" else 0
    time = filter_time(m.y, m.step, 3 + up, _LAGS)
    rows, u = m.rows_behind(time), m.through_chain(m.u)

    def behind(x: Array, order: int) -> Array:
        return filter_bilinear(x, m.step, time, order, _LAGS)[rows]

    columns = [
        -behind(m.y, 1 + up),
        behind(u, 0),
        -behind(u, 1),
        -behind(m.through_chain(m.sense), 0),
        -behind(m.through_chain(np.ones(len(m.t))), 0),
        -behind(m.y, 2 + up),
        -behind(m.y, 3 + up),
        behind(u, 2),
    ]
    return np.column_stack(columns), behind(m.y, up) + m.first_speed


EXPLANATIONS.member("resonance")(_resonance)
