"""The path from input to data at a frequency: held input, motor, delay, samples, measurement chain.

An input that holds between samples and an output that is only seen at samples make the response at a line of the spectrum

    G_d(z) = C (zI - Φ)⁻¹ (Γ₀ + Γ₁ z⁻¹) z⁻ᵐ,   z = e^(jωT)      (Åström and Wittenmark 1997, chapter 2)

which includes every alias of the held input; dividing by the hold's sinc and half sample would leave the aliases in the data.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.matrix_exponential import matrix_exponential
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.systems.transfer_function import TransferFunction

Complex: TypeAlias = NDArray[np.complex128]

_DECAYED = 1e-13  # of an impulse response; what comes after it doesn't count
_LONGEST = 2**20  # samples of an impulse response
_DIGITS = 1e-6  # of the largest value, which numbers in files are rounded to, or finer
_BLOCK = 2**20  # complex exponentials at a time, 16 MB


@dataclass(frozen=True, eq=False)
class Path:
    """From the input to the spectrum of the data, at angular frequencies `omega` (K,) [rad/s] between zero and Nyquist's.

    A position is differenced, so that neither a ramp nor the integrator's state leaks. The `sample_time` is in s.
    """

    data: Dataset
    sample_time: float
    omega: Array

    def full(self, system: TransferFunction) -> Complex:
        """Return the response (K,) from the input to the data, of a system from the input to the shaft."""
        return self.motion(system) * self.measured

    def motion(self, system: TransferFunction) -> Complex:
        """Return the response (K,) from the input to samples of the shaft, of a system between them."""
        total = replace(system, delay=system.delay + self.data.delay)
        return hold_response(total, self.omega, self.sample_time)

    @cached_property
    def measured(self) -> Complex:
        """The response (K,) of chain and difference."""
        return self._chain * self.difference

    @cached_property
    def audible(self) -> Array:
        """The power (K,) of `measured`, but where a chain is silent that of the digits which its numbers are written with.

        A tachometer of 40 ms shows nothing of 25 and 50 Hz: what stands there is rounding, and tells neither motor nor noise.
        """
        power = np.abs(self._chain) ** 2
        return np.asarray(np.maximum(power, _DIGITS**2 * power.max()) * np.abs(self.difference) ** 2)

    @cached_property
    def _chain(self) -> Complex:
        return chain_response(self.data.chain.linear, self.omega, self.sample_time)

    @cached_property
    def difference(self) -> Complex:
        """1 - e^(-jωT) for a position, 1 for a speed, (K,)."""
        if self.data.kind == "speed":
            return np.ones(len(self.omega), dtype=np.complex128)
        return np.asarray(-np.expm1(-1j * self.omega * self.sample_time), dtype=np.complex128)

    def transient(self, system: TransferFunction) -> Complex:
        """Return the shape (K,) of what start states add: 1/(1 - e^(pT) z⁻¹) for the poles p of the system and of the filters.

        A pole at zero has gone with the difference; one on the right counts as its mirror image.
        """
        z = np.exp(1j * self.omega * self.sample_time)
        shape = np.ones(len(z), dtype=np.complex128)
        for pole in system.poles[np.abs(system.poles) * self.sample_time > 1e-12]:
            shape /= 1.0 - np.exp(complex(-abs(pole.real), pole.imag) * self.sample_time) / z
        return shape * self._filter_transient

    @cached_property
    def _filter_transient(self) -> Complex:
        """The factor (K,) of the filters in `transient`."""
        shape = np.ones(len(self.omega), dtype=np.complex128)
        for stage in self.data.chain.linear.stages:
            decay = stage.start_response(np.zeros(1))
            if decay is not None:
                shape *= _transform(
                    _until_decayed(stage.start_response, self.sample_time), self.omega, self.sample_time
                )
        return shape


def hold_response(system: TransferFunction, omega: Array, sample_time: float) -> Complex:
    """Return the response (K,) at ω (K,) [rad/s] from an input that holds between samples to samples of the output, exact.

    Over a sample the delay d = mT + f splits the hold: Γ₁ is what the older value does in [0, f), Γ₀ what the newer one does
    in [f, T). In δ = z - 1 nothing cancels at low frequencies. Raises `UsageError` where the output jumps with the input.
    """
    order = len(system.denominator) - 1
    if len(system.numerator) > order:
        raise UsageError(
            f"the output of {system} jumps with the input: its samples have no value there; use a proper transfer function"
        )
    whole = float(np.floor(system.delay / sample_time))
    rest = system.delay - whole * sample_time
    shift, scale, output = _canonical(system)
    transitions, (newer, older, _) = _over(shift, scale * np.array([sample_time - rest, rest, sample_time]))
    older = older + transitions[0] @ older  # through what is left of the sample
    delta = np.expm1(1j * omega * sample_time)
    (new, old), below = _ratio(transitions[2], (newer, older), output)
    above = np.polyval(new, delta) + np.polyval(old, delta) / (1.0 + delta)
    return np.asarray(above / np.polyval(below, delta) * (1.0 + delta) ** -whole, dtype=np.complex128)


def _canonical(system: TransferFunction) -> tuple[Array, float, Array]:
    """A (n, n) and C (n,) of the controllable canonical form, B = (1, 0, ..., 0), in a time scaled by σ, and σ itself [1/s]."""
    a = np.asarray(system.denominator) / system.denominator[0]
    n = len(a) - 1
    powers = np.arange(1, n + 1)
    sigma = float(np.max(np.abs(a[1:]) ** (1.0 / powers))) or 1.0
    shift = np.zeros((n, n))
    shift[0] = -a[1:] / sigma**powers
    shift[1:, :-1] = np.eye(n - 1)
    output = np.zeros(n)
    output[n - len(system.numerator) :] = system.numerator
    return shift, sigma, output / system.denominator[0] / sigma**powers


def _over(shift: Array, times: Array) -> tuple[Array, Array]:
    """e^(At) - I (M, n, n) and ∫ e^(As) ds B (M, n) over scaled times (M,)."""
    n = len(shift)
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:] = shift, np.eye(n)
    integrals = matrix_exponential(block * times[:, None, None])[:, :n, n:]
    return shift @ integrals, integrals[:, :, 0]


def _ratio(step: Array, inputs: tuple[Array, Array], output: Array) -> tuple[list[Array], Array]:
    """Numerators C adj(δI - F) Γ for each input Γ and the denominator det(δI - F), in powers of δ (Faddeev and Leverrier)."""
    n = len(step)
    adjoint, below = np.eye(n), [1.0]
    above: list[list[float]] = [[] for _ in inputs]
    for k in range(1, n + 1):
        for terms, gamma in zip(above, inputs, strict=True):
            terms.append(float(output @ adjoint @ gamma))
        product = step @ adjoint
        below.append(-float(np.trace(product)) / k)
        adjoint = product + below[-1] * np.eye(n)
    return [np.array(terms) for terms in above], np.array(below)


def chain_response(chain: Chain, omega: Array, sample_time: float) -> Complex:
    """Return the response (K,) of a linear chain of stages at ω (K,) [rad/s], exact for regular samples.

    It is the transform of the chain's answer to one sample, as far as that lasts. Raises `UsageError` where it doesn't end.
    """
    if not chain:
        return np.ones(len(omega), dtype=np.complex128)
    lead = int(np.argmax(_valid_for_long(chain, sample_time))) + 1

    def answer(t: Array) -> Array:
        after = np.concatenate([sample_time * np.arange(-lead, 0), t])
        return chain((np.arange(len(after)) == lead).astype(np.float64), after)[lead:]

    return _transform(_until_decayed(answer, sample_time), omega, sample_time)


def _valid_for_long(chain: Chain, sample_time: float) -> NDArray[np.bool_]:
    count = 64
    while True:
        valid = chain.valid(_times(count, sample_time))
        if valid.any() or count >= _LONGEST:
            return valid
        count *= 2


def _until_decayed(answer: Callable[[Array], Array | None], sample_time: float) -> Array:
    """An answer at times from 0 on, as long as it takes for it to vanish."""
    count = 64
    while count <= _LONGEST:
        response = np.asarray(answer(_times(count, sample_time)), dtype=np.float64)
        if np.abs(response[-count // 4 :]).max() <= _DECAYED * np.abs(response).max():
            return response
        count *= 4
    raise UsageError(
        f"a stage of the chain still responds after {_LONGEST} samples: its frequency response can't be divided out"
    )


def _times(count: int, sample_time: float) -> Array:
    return np.asarray(sample_time * np.arange(count), dtype=np.float64)


def _transform(x: Array, omega: Array, sample_time: float) -> Complex:
    """Σ x[n] e^(-jωnT) at ω (K,), as many at a time as fit in memory."""
    n = int(np.flatnonzero(x)[-1]) + 1 if x.any() else 1
    out = np.empty(len(omega), dtype=np.complex128)
    rows = max(1, _BLOCK // n)
    for first in range(0, len(omega), rows):
        part = omega[first : first + rows]
        out[first : first + rows] = np.exp(-1j * sample_time * np.outer(part, np.arange(n))) @ x[:n]
    return out
