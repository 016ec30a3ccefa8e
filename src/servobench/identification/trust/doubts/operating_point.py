"""A gain that belongs to one operating point, or to two levels."""

from __future__ import annotations

import numpy as np

from servobench.core.finding import Finding, info
from servobench.core.rounding import with_unit
from servobench.identification.estimators.base import Fit
from servobench.identification.models.first_motion import rests_at_first
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset


def _about_fit(fit: Fit) -> list[Finding]:
    return [*_local(fit), *_levels(fit)]


def _local(fit: Fit) -> list[Finding]:
    """Whether the input stayed near one level, so that the gain belongs to that level only."""
    inputs = np.concatenate([record.data.u for record in fit.records])
    low, high = (float(level) for level in np.percentile(inputs, (1, 99)))
    largest = max(abs(low), abs(high))
    if high - low >= 0.5 * largest:
        return []
    unit = fit.records[0].data.input_unit
    lowest, highest = with_unit(low, unit, 3), with_unit(high, unit, 3)
    where = f"between {lowest} and {highest}" if lowest != highest else f"at {lowest}"
    return [
        info(
            "gain-local",
            f"The input stayed {where}: the gain and the offset hold at this operating point "
            "only; record other levels for a wider range.",
            parameters=("gain", "coulomb_voltage"),
        )
    ]


def _levels(fit: Fit) -> list[Finding]:
    """Whether two points are all that the line through the levels has."""
    records = [record.data for record in fit.records]
    levels = np.unique(np.round(np.concatenate([record.u for record in records]), 9))
    verb = "has"
    if len(levels) == 3 and 0.0 in levels and all(map(_begins_with_a_rest, records)):
        # A shaft that hasn't moved yet shows nothing of its motor.
        levels, verb = levels[levels != 0.0], "drives the motor at"
    if len(levels) != 2:
        return []
    unit = records[0].input_unit
    # A limit of the current makes another, slower motor of it at two levels, and no residual shows that. Of levels that differ
    # in sign alone, or of one and none, what the driver drops is the same whenever it drives.
    drops = "drops a part of the input or " if -levels[0] == levels[1] or 0.0 in levels else ""
    driver = "" if unit == "A" else f", and whether the driver {drops}limits the current"
    sentence = (
        f"The input {verb} two levels only, {with_unit(levels[0], unit)} and {with_unit(levels[1], unit)}, and the "
        f"gain is that between them. It takes a staircase or a multisine to show whether the motor is linear there{driver}."
    )
    return [info("two-levels", sentence, parameters=("gain",))]


def _begins_with_a_rest(record: Dataset) -> bool:
    """Whether the input is zero at the beginning only, and the shaft stands there."""
    driven = np.flatnonzero(record.u)
    return len(driven) > 0 and bool(np.all(record.u[driven[0] :])) and rests_at_first(record)


DOUBTS.member("operating_point")(Doubt(codes=("gain-local", "two-levels"), about_fit=_about_fit))
