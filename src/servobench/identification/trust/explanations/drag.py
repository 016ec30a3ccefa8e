"""Drag that grows with the square of the speed: air, water, a fan or a propeller."""

from __future__ import annotations

import numpy as np

from servobench.core.finding import warning
from servobench.identification.models.motion import smooth_speed
from servobench.identification.trust.explanations.base import EXPLANATIONS, Case
from servobench.identification.trust.explanations.cause import CauseFit
from servobench.identification.trust.explanations.equation import sweep_count, with_extra
from servobench.recordings.measurement.dataset import Dataset


def _drag(case: Case) -> CauseFit | None:
    """Whether K c ω|ω| makes the equation hold, with a drag that brakes."""
    # Behind a chain the measured speed is another than the one that the drag goes by. Under one level from the first row on,
    # the only speed that lasts is that one's, which says nothing of how drag grows.
    if (
        any(each.data.chain.linear for each in case.motions)
        or max(sweep_count(each.u) for each in case.motions) < 1.0
    ):
        return None
    speeds = [np.interp(each.t, each.data.t_output, smooth_speed(each.data)) for each in case.motions]
    drag_regression = case.with_columns(
        [-each.filter_through_chain(w * np.abs(w)) for each, w in zip(case.motions, speeds, strict=True)]
    )
    brakes, gain = float(drag_regression.coefficients[5]), float(drag_regression.coefficients[1] or 1.0)
    factor = brakes / gain
    size = brakes / abs(gain) * max(float(np.percentile(np.abs(w), 99)) for w in speeds) ** 2
    if not 0 < size <= max(float(np.abs(each.u).max()) for each in case.motions):
        return None
    unit = case.motions[0].data.input_unit
    sentence = (
        f"Drag grows with the square of the speed, as with air or a fan: it takes about {size:.2g} "
        f"{unit} of the input at the largest speed. A model that is linear in the speed has too "
        "small a gain and the wrong friction; record at lower speeds, or use the model at these "
        "speeds only."
    )
    return CauseFit(
        finding=warning("drag-not-linear", sentence, parameters=("gain", "time_constant", "coulomb_voltage")),
        structural=True,
        misfit=drag_regression.misfit,
        chosen=1,
        remedy=lambda data: without_drag(data, factor),
    )


def without_drag(data: Dataset, factor: float) -> Dataset:
    """Return a record whose input is less by c ω|ω|, c in the unit of the input over the square of the speed's."""
    speed = smooth_speed(data)
    lost = factor * speed * np.abs(speed)
    return with_extra(data, lambda t, u: -np.interp(t, data.t_output, lost))


EXPLANATIONS.member("drag")(_drag)
