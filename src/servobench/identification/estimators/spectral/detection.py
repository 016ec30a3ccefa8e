"""Detection lines: the output at harmonics that a periodic input doesn't have; a linear motor has none there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.identification.estimators.spectral.local import Local


@dataclass(frozen=True, kw_only=True, eq=False)
class DetectionLines:
    """Amplitudes (L,) of the output at harmonics `omega` (L,) [rad/s] that the input leaves out, in the data's output unit.

    `noise` (L,) is the root mean square of what noise makes of such an amplitude, known from between the harmonics. What stands
    out of it is distortion: at even harmonics (not `odd`) by something that isn't symmetric, such as a load that depends on the
    angle, at odd ones by something that is, such as Coulomb friction. An input that has all odd harmonics up to its highest shows
    even distortion alone below that (Pintelon and Schoukens 2012, chapter 4).
    """

    omega: Array
    amplitude: Array
    noise: Array
    odd: NDArray[np.bool_]

    def level(self, *, odd: bool) -> float:
        """Return the root mean square of the distortion at odd or at even harmonics, noise taken off; NaN without any."""
        which = self.odd == odd
        if not which.any():
            return float("nan")
        return float(np.sqrt(max(np.mean(self.amplitude[which] ** 2 - self.noise[which] ** 2), 0.0)))


def detection_lines(locals_of_stretches: Sequence[Local]) -> DetectionLines | None:
    """Return the detection lines of all stretches that repeat, ascending; None where there are none."""
    parts = [
        _of(local)
        for local in locals_of_stretches
        if len(local.stretch.detection) and local.stretch.cycles > 1
    ]
    if not parts:
        return None
    omega, amplitude, noise, odd = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(omega, kind="stable")
    return DetectionLines(
        omega=omega[order], amplitude=amplitude[order], noise=noise[order], odd=odd[order] > 0
    )


def _of(local: Local) -> tuple[Array, Array, Array, Array]:
    """ω, amplitude, noise and parity: a cosine of amplitude a has the line a √N / 2."""
    stretch = local.stretch
    at = stretch.detection - 1
    factor = 2.0 / np.sqrt(stretch.count) / np.abs(stretch.path.difference[at])
    noise = np.sqrt(local.noise[at] * (1.0 + local.leverage[at]))
    odd = np.asarray((stretch.detection // stretch.cycles) % 2, dtype=np.float64)
    return stretch.path.omega[at], np.abs(local.left[at]) * factor, noise * factor, odd
