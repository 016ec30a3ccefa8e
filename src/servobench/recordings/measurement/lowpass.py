"""The stage `lowpass`: a first-order low-pass filter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar, Literal, Self, TypeAlias, get_args

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.numbers import check_positive, number_text
from servobench.recordings.measurement.base import STAGES, Kind
from servobench.recordings.measurement.stage_text import quantity_in

Discretisation: TypeAlias = Literal["euler", "zoh", "tustin"]


@STAGES.member("lowpass")
@dataclass(frozen=True, kw_only=True)
class Lowpass:
    """The filter ω/(s + ω), with ω the `cutoff` [rad/s], computed once a sample (Franklin, Powell and Workman 1998, chapter 6).

    With h = ω Δt for the time Δt since the sample before, y[k] = a y[k-1] + b x[k] + c x[k-1], where

    - `tustin`, the trapezoid rule: a = (1 - h/2)/(1 + h/2), b = c = (h/2)/(1 + h/2);
    - `euler`, the forward Euler step of a fixed-step simulation loop (Simulink's ode1, LabVIEW's RK1):
      a = 1 - h, b = 0, c = h; it rings from h = 1 and diverges from h = 2;
    - `zoh`, exact for an input that holds from sample to sample: a = e^-h, b = 0, c = 1 - e^-h.

    The state starts at zero, and the first output is zero.
    The default, Tustin, is the nearest to the filter that the text names where nobody knows how it was computed: like the
    continuous filter and like forward Euler it delays slow signals by 1/ω (`zoh` by half a sample more, which an identified delay
    would have to make up for), it is right to second order in h, and it is stable with any step, such as that of a log
    sampled more slowly than its filter ran.
    Raises `UsageError` for a cut-off that isn't above 0, and a discretisation that isn't known.
    """

    linear: ClassVar[bool] = True
    examples: ClassVar[tuple[str, ...]] = (
        "lowpass 50 rad/s",
        "lowpass 8 Hz euler",
        "lowpass 8 Hz zoh",
        "lowpass 50 rad/s tustin",
    )

    cutoff: float = field(metadata={"unit": "rad/s"})
    discretisation: Discretisation = "tustin"

    def __post_init__(self) -> None:
        check_positive("the cut-off of a low-pass filter", self.cutoff, "rad/s")
        if self.discretisation not in _COEFFICIENTS:
            known = ", ".join(get_args(Discretisation))
            raise UsageError(
                f"a low-pass filter can't be computed by {self.discretisation!r}; known: {known}"
            )

    @classmethod
    def parse(cls, arguments: tuple[str, ...]) -> Self:
        """Return the filter for a cut-off with its unit, and a way to compute it or none (`50 rad/s euler`, `8 Hz`)."""
        last = arguments[-1] if arguments else ""
        for discretisation in get_args(Discretisation):
            if last == discretisation:
                cutoff = quantity_in("rad/s", "lowpass", arguments[:-1], cls.examples[:2])
                return cls(cutoff=cutoff, discretisation=discretisation)
        return cls(cutoff=quantity_in("rad/s", "lowpass", arguments, cls.examples[:2]))

    @property
    def symbol(self) -> tuple[str, ...]:
        """Numerator and denominator of the transfer function, for a diagram."""
        return number_text(self.cutoff), f"s + {number_text(self.cutoff)}"

    def yields(self, kind: Kind) -> Kind:
        """The same as goes in."""
        return kind

    def first_valid(self, first: int, t: Array) -> int:
        """The first valid input gives the first valid output, but for the start state."""
        return first

    def start_response(self, t: Array) -> Array:
        """The product of all a up to each sample: about e^(-ω (t - t[0]))."""
        decay, _, _ = self._coefficients(np.diff(t, prepend=t[:1]))
        return np.asarray(np.cumprod(decay), dtype=np.float64)

    def start(self) -> tuple[float, float]:
        """No output and no input before the first sample."""
        return 0.0, 0.0

    def step(self, state: tuple[float, float], x: float, dt: float) -> tuple[tuple[float, float], float]:
        """One sample of the recursion; the state is the output and the input of the sample before."""
        before, x_before = state
        decay, new, old = self._coefficients(np.array([dt]))
        y = float(decay[0]) * before + float(new[0]) * x + float(old[0]) * x_before
        return (y, x), y

    def block(self, state: tuple[float, float], x: Array, dt: Array) -> tuple[tuple[float, float], Array]:
        """The recursion over a block of samples (N,), N at least 1; raises `UsageError` where forward Euler diverges."""
        from servobench.recordings.measurement.kernels import first_order_recursion, tustin_lowpass

        before, x_before = state
        if self.discretisation == "tustin":
            y = tustin_lowpass(x, dt, self.cutoff, before, x_before)
            return (float(y[-1]), float(x[-1])), y
        decay, new, old = self._coefficients(dt)
        drive = new * x + old * np.concatenate([[x_before], x[:-1]])
        drive[0] += decay[0] * before
        y = first_order_recursion(decay, drive[:, None])[:, 0]
        return (float(y[-1]), float(x[-1])), y

    def __call__(self, x: Array, t: Array) -> Array:
        """The recursion over a whole record; raises `UsageError` where forward Euler diverges."""
        from servobench.recordings.measurement.kernels import first_order_recursion

        decay, new, old = self._coefficients(np.diff(t, prepend=t[:1]))
        signals = x.reshape(len(x), -1) if x.size else x.reshape(len(x), 0)
        drive = new[:, None] * signals
        drive[1:] += old[1:, None] * signals[:-1]
        return first_order_recursion(decay, np.ascontiguousarray(drive)).reshape(x.shape)

    def __str__(self) -> str:
        how = "" if self.discretisation == "tustin" else f" {self.discretisation}"
        return f"lowpass {number_text(self.cutoff)} rad/s{how}"

    def _coefficients(self, dt: Array) -> tuple[Array, Array, Array]:
        """Return a, b and c for the times dt (N,) [s] since the sample before."""
        h = self.cutoff * dt
        if self.discretisation == "euler" and (h >= 2.0).any():
            raise UsageError(
                f"`{self}` diverges: forward Euler needs cut-off × time step below 2, and with a step of {dt.max():g} s it is "
                f"{h.max():g}; write `lowpass {number_text(self.cutoff)} rad/s tustin`, or sample more often"
            )
        return _COEFFICIENTS[self.discretisation](h)


def _euler(h: Array) -> tuple[Array, Array, Array]:
    return 1.0 - h, np.zeros_like(h), h


def _zoh(h: Array) -> tuple[Array, Array, Array]:
    return np.exp(-h), np.zeros_like(h), -np.expm1(-h)


def _tustin(h: Array) -> tuple[Array, Array, Array]:
    gain = 0.5 * h / (1.0 + 0.5 * h)
    return (1.0 - 0.5 * h) / (1.0 + 0.5 * h), gain, gain


_COEFFICIENTS: dict[str, Callable[[Array], tuple[Array, Array, Array]]] = {
    "euler": _euler,
    "zoh": _zoh,
    "tustin": _tustin,
}
