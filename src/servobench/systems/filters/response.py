"""The properties of a stage or a speed estimate from its impulse response: response, lag and gain over frequency."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.numbers import check_positive
from servobench.systems.filters.base import SpeedEstimate

_SHORTEST, _LONGEST = 256, 1 << 20  # samples
_GONE = 1e-14  # of the largest sample of a response: the rest is rounding


def impulse_response(estimate: SpeedEstimate, sample_time: float) -> Array:
    """Return the samples g (N,) that come out from where a one goes in among zeros, as far as they are not zero.

    It is found by letting the one pass, so it is that of the very code that works on recordings. `sample_time` is in s.
    Raises `UsageError` where the response doesn't die out within a million samples.
    """
    check_positive("the sample time", sample_time, "s")
    length = _SHORTEST
    while length <= _LONGEST:
        x = np.zeros(2 * length)
        x[length] = 1.0  # late enough for every window to be filled
        g = estimate(x, sample_time * np.arange(2 * length, dtype=np.float64))[length:]
        nonzero = np.flatnonzero(np.abs(g) > _GONE * np.abs(g).max())
        if len(nonzero) and nonzero[-1] < length // 2:
            return np.asarray(g[: nonzero[-1] + 1])
        length *= 4
    raise UsageError(
        f"`{estimate}` at {sample_time:g} s still responds to a sample {_LONGEST} samples later; expected a response "
        "that dies out: use a higher cut-off or a shorter window"
    )


def frequency_response(estimate: SpeedEstimate, omega: Array, sample_time: float) -> NDArray[np.complex128]:
    """Return G(e^{jωT}) = Σ g[k] e^{-jωkT} (N,) at angular frequencies ω (N,) [rad/s]; above π/T it repeats itself."""
    g = impulse_response(estimate, sample_time)
    turns = np.exp(-1j * sample_time * np.asarray(omega, dtype=np.float64))
    return np.asarray(np.polynomial.polynomial.polyval(turns, g), dtype=np.complex128)


def lag(estimate: SpeedEstimate, sample_time: float) -> float:
    """Return by how much a speed that changes slowly comes out late [s]: -(T²/2) Σ k² g[k], of the position's response g.

    It follows from G(e^{sT}) = s (1 - s lag + …) near s = 0, as a speed is the derivative of its position. A difference has
    T/2, a low-pass filter adds 1/ω by forward Euler or Tustin, and T/(1 - e^{-ωT}), half a sample more, by ZOH.
    Raises `UsageError` for what makes no speed of a steadily growing position.
    """
    g = impulse_response(estimate, sample_time)
    k = np.arange(len(g), dtype=np.float64)
    gain = -sample_time * float(g @ k)
    if abs(float(g.sum())) * sample_time > 1e-9 or abs(gain - 1.0) > 1e-6:
        raise UsageError(
            f"`{estimate}` shows {gain:.6g} rad/s for a shaft that turns at 1 rad/s; expected an estimate of the "
            "speed from the position, such as `derivative | lowpass 50 rad/s`"
        )
    return float(-0.5 * sample_time**2 * (g @ k**2))
