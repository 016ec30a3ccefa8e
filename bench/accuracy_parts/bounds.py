"""The smallest standard deviations that an unbiased estimator can have (Cramér-Rao), from differences of an exact simulation.

"Gaussian-equivalent": the encoder's rounding is taken as white noise of variance Q²/12. An ideal encoder's real error is
neither white nor Gaussian, so that a good estimator may do a little better. All unknowns are in it: K, τ, the start, the lost
voltages, the delay.
"""

from dataclasses import dataclass, fields, replace

import numpy as np

from accuracy_parts import kernels
from accuracy_parts.inputs import SAMPLE_TIME, SAMPLES, Array, delayed


@dataclass(frozen=True, kw_only=True)
class FirstOrder:
    """τ dω/dt = -ω + K (u(t - d) - u₀ - u_c sgn ω), dθ/dt = ω, with θ and ω at the first sample."""

    gain: float
    tau: float
    angle: float = 0.0
    speed: float = 0.0
    offset: float = 0.0
    coulomb: float = 0.0
    delay: float = 0.0


# The steps of the differences. Large compared with the rounding of the simulation (1e-13 rad), small compared with any curvature.
_STEPS = {
    "gain": 1e-4,
    "tau": 1e-6,
    "angle": 1e-3,
    "speed": 1e-3,
    "offset": 1e-5,
    "coulomb": 1e-5,
    "delay": 1e-6,
}


def position(p: FirstOrder, u: Array, before: float) -> Array:
    """Return the angle (N,) at the samples, exactly, for a held input u (N,)."""
    late, held, first = delayed(u - p.offset, before - p.offset, p.delay)
    out = np.empty((len(u), 2))
    kernels.coulomb((p.gain, p.tau, p.coulomb), late, held, first, SAMPLE_TIME, (p.speed, p.angle), out)
    return out[:, 1]


def jacobian(p: FirstOrder, u: Array, before: float, names: tuple[str, ...]) -> Array:
    """Return the derivatives of the angle (N, C) by those parameters, by differences of second order.

    A delay and a Coulomb voltage near zero are stepped upwards only; below zero the simulation has no meaning.
    """
    columns = []
    for name in names:
        value, h = getattr(p, name), _STEPS[name]
        one_sided = name in ("delay", "coulomb") and value < h
        steps, weights = (
            ((0.0, h, 2 * h), (-1.5, 2.0, -0.5)) if one_sided else ((-h, 0.0, h), (-0.5, 0.0, 0.5))
        )
        near = [position(replace(p, **{name: value + step}), u, before) for step in steps]
        columns.append(sum(weight * y for weight, y in zip(weights, near, strict=True)) / h)
    return np.column_stack(columns)


def bound(
    p: FirstOrder,
    u: Array,
    before: float,
    variance: float,
    intensity: float = 0.0,
    reversing: bool = False,
) -> dict[str, float]:
    """Return the bounds on the relative sd of gain and time constant, and on the sd of the delay [s].

    `variance` is that of a sample's noise [rad²], `intensity` that of a white acceleration [rad²/s³]: then the Jacobian goes
    through the filter of the true levels. Turning one way, Coulomb and offset voltage are one unknown.
    """
    names = tuple(f.name for f in fields(p) if reversing or f.name != "coulomb")
    j = jacobian(p, u, before, names)
    if intensity:
        kernels.innovate(*transition(p.tau, intensity), variance, j)
    else:
        j /= np.sqrt(variance)
    informed = np.linalg.norm(j, axis=0) > 0
    scale = np.linalg.norm(j[:, informed], axis=0)
    inverse = np.linalg.inv((j[:, informed] / scale).T @ (j[:, informed] / scale))
    sd = np.sqrt(np.diag(inverse)) / scale
    found = dict(zip(np.array(names)[informed].tolist(), sd.tolist(), strict=True))
    return {
        "gain": found["gain"] / p.gain,
        "time_constant": found["tau"] / p.tau,
        "delay": found["delay"],
    }


def held(a: Array, b: Array, h: float) -> tuple[Array, Array]:
    """Return Φ (S, S) and Γ (S,) of x(t + h) = Φ x(t) + Γ u for a held input, by the exponential of the joint matrix."""
    from scipy.linalg import expm

    size = len(b)
    joint = np.zeros((size + 1, size + 1))
    joint[:size, :size], joint[:size, size] = a, b
    e = expm(joint * h)
    return np.ascontiguousarray(e[:size, :size]), np.ascontiguousarray(e[:size, size])


def transition(tau: float, intensity: float) -> tuple[Array, Array]:
    """Return the transition (2, 2) of (θ, ω) over a tick and the covariance that white acceleration adds to it.

    Van Loan (1978): both from one exponential.
    """
    from scipy.linalg import expm

    f = np.array([[0.0, 1.0], [0.0, -1 / tau]])
    joint = np.zeros((4, 4))
    joint[:2, :2], joint[:2, 2:], joint[2:, 2:] = -f, np.diag([0.0, intensity]), f.T
    e = expm(joint * SAMPLE_TIME)
    a = np.ascontiguousarray(e[2:, 2:].T)
    noise = a @ e[:2, 2:]
    return a, np.ascontiguousarray(0.5 * (noise + noise.T))


def wander(p: FirstOrder, intensity: float, random: np.random.Generator) -> Array:
    """Return what white acceleration [rad²/s³] adds to the angle (N,), exact at the samples."""
    if not intensity:
        return np.zeros(SAMPLES)
    a, noise = transition(p.tau, intensity)
    kicks = random.standard_normal((SAMPLES, 2)) @ np.linalg.cholesky(noise).T
    out, none = np.empty((SAMPLES, 2)), np.zeros(2)
    kernels.linear(np.eye(2), none, a, none, np.zeros(SAMPLES), np.zeros(SAMPLES), np.zeros(2), kicks, out)
    return out[:, 0]


def interval_information(noise: float, quantum: float) -> float:
    """Return the information of a count about the angle [1/rad²], the mean over all angles; Gaussian noise [rad] before rounding.

    Each count says that angle and noise lie in its quantum: I = Σ P'²/P over the counts.
    """
    from scipy.special import ndtr

    phase = (np.arange(4000) + 0.5) / 4000 * quantum
    total = np.zeros_like(phase)
    for count in range(-8, 9):
        low, high = (count * quantum - phase) / noise, ((count + 1) * quantum - phase) / noise
        p = ndtr(high) - ndtr(low)
        slope = (np.exp(-0.5 * low**2) - np.exp(-0.5 * high**2)) / np.sqrt(2 * np.pi) / noise
        total += np.where(p > 1e-300, slope**2 / np.maximum(p, 1e-300), 0.0)
    return float(total.mean())
