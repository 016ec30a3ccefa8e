"""The figures of a model: frequency response, step response and poles, each with a text description."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from servobench.core.rounding import plain, round_value, with_unit
from servobench.identification.estimators.base import Fit
from servobench.identification.uncertainty.bands import (
    FrequencyBand,
    PoleBand,
    frequency_band,
    pole_bands,
    step_band,
)
from servobench.identification.uncertainty.propagation import Derived, sample_time_of
from servobench.report import model_figures, summary
from servobench.report.illustrations import Illustration
from servobench.systems.stability.verdict import stability
from servobench.systems.transfer_function import TransferFunction

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from servobench.report.palette import Style

_POINTS = 400  # of a curve over frequency or time
_LINE_WIDTH = 1.8 / 150  # of a curve, as a part of its panel's height


def frequency_response(fit: Fit, derived: Mapping[str, Derived]) -> Illustration | None:
    """Return magnitude and phase over frequency, with their bands and the range that the data can tell of.

    None for a model without a gain, which has no magnitude that a logarithm could be taken of.
    """
    system = fit.model.transfer_function("speed")
    if not any(system.numerator):
        return None
    frequency_range = _frequency_range(fit)
    sizes = [abs(pole) for pole in system.poles if pole != 0]
    low, high = (
        min([frequency_range[0], *(size / 10 for size in sizes)]),
        max([frequency_range[1], *(size * 10 for size in sizes)]),
    )
    band = frequency_band(fit, np.geomspace(low, high, _POINTS))
    corner = float(sizes[0]) if len(system.poles) == 1 and sizes else None
    text = _band_words(band, frequency_range)
    bandwidth = summary.quantity(
        "The bandwidth (the magnitude falls to 0.707 of its static value) is", derived["bandwidth"]
    )
    knee = f" The corner is at {with_unit(corner, 'rad/s', 4)}." if corner is not None else ""
    return Illustration(
        name="bode",
        title="Frequency response from the input to the speed",
        caption=(
            f"{bandwidth} {text} Shaded frequencies are outside the data: below one cycle in the longest record, or "
            f"above half the sample rate ({plain(frequency_range[0], 3)} to {plain(frequency_range[1], 3)} rad/s is inside)."
        ).lstrip(),
        description=f"Bode diagram. The magnitude is {_magnitude_words(band, system)}.{knee} {text}",
        draw=_measured_diagram(fit, band)
        or partial(model_figures.bode, band, system.unit, frequency_range, corner),
    )


def _measured_diagram(fit: Fit, band: FrequencyBand) -> Callable[[Style], Figure] | None:
    """The diagram with the points that were measured, for a fit that was made to them."""
    if fit.estimator != "frequency_response":
        return None
    from servobench.identification.estimators import frequency_response as measurement
    from servobench.report.frequency_figures import measured_bode

    data = [record.data for record in fit.records]
    response = measurement.frequency_response(data, near=fit.structure)
    return partial(measured_bode, response.as_speed(), band)


def step_response(fit: Fit, derived: Mapping[str, Derived]) -> Illustration:
    """Return the speed after a step of one unit of input."""
    system = fit.model.transfer_function("speed")
    slowest = max((1 / abs(pole.real) for pole in system.poles if pole.real != 0), default=1.0)
    t = np.linspace(0.0, max(system.delay, 0.0) + 5 * slowest, _POINTS)
    band = step_band(fit, t)
    unit = f"{fit.model.data.position_unit}/s"
    input_unit = fit.model.data.input_unit
    mark = None
    if len(system.poles) == 1 and system.poles[0].real < 0:
        after = system.delay + slowest
        mark = (float(after), float(np.interp(after, t, band.y)))
    final = f"{plain(band.y[-1])} {unit} after {with_unit(float(t[-1]), 's', 2)}"
    widest = 2 * float(np.max(band.half))
    width = _band_width(widest, float(np.ptp(band.y)), f"{plain(widest / 2, 2)} {unit}")
    return Illustration(
        name="step",
        title=f"Response to a step of 1 {input_unit}",
        caption=(
            "Of the linear part, from rest; friction and offset are left out. "
            f"{summary.quantity('The rise time from 10 to 90 % is', derived['rise_time'])} {width}"
        ),
        description=f"The speed goes to {final}. {width}",
        draw=partial(model_figures.step, band, unit, mark),
    )


def poles(fit: Fit, derived: Mapping[str, Derived]) -> Illustration:
    """Return the poles in the complex plane and what they mean for stability, also under feedback."""
    bands = pole_bands(fit)
    judged = stability(fit.model.transfer_function("speed"))
    reasons = re.sub(r"(?<=[ (±])-(?=\d)", "−", " ".join(judged.reasons))
    return Illustration(
        name="poles",
        title="Poles",
        caption=(
            f"From the input to the speed the motor is {judged.verdict}. {reasons} The thin cross at 0 is the "
            "integrator from speed to position, which isn't estimated. "
            f"{summary.feedback(derived, fit.model.data, sample_time_of(fit))}"
        ),
        description=f"Pole map. {' '.join(map(_pole_words, bands))}",
        draw=partial(model_figures.pole_map, bands, 0j),
    )


def _frequency_range(fit: Fit) -> tuple[float, float]:
    """The range of angular frequencies [rad/s] from one cycle in the longest record to half the fastest sample rate."""
    records = [record.data for record in fit.records]
    longest = max(record.duration for record in records)
    return 2 * np.pi / longest, np.pi / min(record.sample_time for record in records)


def _band_words(band: FrequencyBand, frequency_range: tuple[float, float]) -> str:
    within = (band.omega >= frequency_range[0]) & (band.omega <= frequency_range[1])
    within = within if within.any() else np.ones_like(within)
    db = float(20 / np.log(10) * band.magnitude_half[within].max())
    degrees = float(np.degrees(band.phase_half[within].max()))
    magnitude = _band_part("magnitude", db, float(np.ptp(20 * np.log10(band.magnitude))), " dB")
    phase = _band_part("phase", degrees, float(np.ptp(np.degrees(band.phase))), "°")
    return f"{magnitude} {phase}"


def _band_part(what: str, half: float, span: float, unit: str) -> str:
    if not np.isfinite(half):
        return f"The 95 % band of the {what} isn't known, as the data don't determine all parameters."
    return (
        f"The 95 % band of the {what} is {_visibility_text(2 * half, span)}, at most ±{plain(half, 2)}{unit}."
    )


def _visibility_text(width: float, span: float) -> str:
    """The visible part of a band if a curve over that span fills its panel."""
    return "thinner than the line" if width < _LINE_WIDTH * span else "light blue"


def _band_width(width: float, span: float, half: str) -> str:
    if not np.isfinite(width):
        return "The 95 % band isn't known, as the data don't determine all parameters."
    return f"The 95 % band is {_visibility_text(width, span)}: at most ±{half}."


def _magnitude_words(band: FrequencyBand, system: TransferFunction) -> str:
    first, last = (20 * np.log10(band.magnitude[n]) for n in (0, -1))
    return (
        f"{plain(first, 3)} dB at {plain(band.omega[0], 2)} rad/s and {plain(last, 3)} dB at "
        f"{plain(band.omega[-1], 2)} rad/s, with 0 dB at 1 {system.unit}"
    )


def _pole_words(band: PoleBand) -> str:
    real = round_value(band.pole.real, band.half.real, "1/s")
    if band.pole.imag == 0:
        return f"A pole at {real}."
    return f"A pole with the real part {real} and the imaginary part {round_value(band.pole.imag, band.half.imag, '1/s')}."
