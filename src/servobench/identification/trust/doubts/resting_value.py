"""An input whose resting value isn't zero, as the duty of a bridge in locked antiphase is, or the pulse of a model servo."""

from __future__ import annotations

import numpy as np

from servobench.core.finding import Finding, warning
from servobench.core.rounding import plain, with_unit
from servobench.identification.estimators.base import Fit
from servobench.identification.models.motion import smooth_speed, turns_both_ways
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset

# Of the input's range: the value at rest, if the motor is driven about as hard either way.
_MIDDLE = (0.3, 0.7)
_LOWEST, _FEW = 0.02, 5  # of the input's range; samples
_STANDS = 0.1  # of the speed at which a motor turns otherwise
_DUTY = frozenset({"duty-scaled", "supply-applied"})


def _about_fit(fit: Fit) -> list[Finding]:
    """Whether a duty has one sign, and the shaft turns both ways about a value in the middle of its range.

    Of a voltage that is no trap: an amplifier with such an offset has the gain that comes out.
    """
    records = [each.data for each in fit.records]
    if (
        "offset_voltage" not in fit.model.names
        or not all(map(is_duty, records))
        or not turns_both_ways(records)
    ):
        return []
    inputs = np.concatenate([record.u for record in records])
    low, high = float(inputs.min()), float(inputs.max())
    rest = fit["offset_voltage"].value
    share = (rest - low) / (high - low) if high > low else 0.0
    if low < 0.0 < high or not _MIDDLE[0] <= share <= _MIDDLE[1] or all(map(_rests_at_lowest, records)):
        return []
    unit = records[0].input_unit
    sentence = (
        f"The input stays between {plain(low, 3)} and {with_unit(high, unit)}, but the shaft turns both ways and rests at "
        f"{with_unit(rest, unit)}. If the range of the duty is from -supply to +supply, the gain is twice what it should be: "
        "for a duty of 0 to 255 write (value - 127.5)/127.5 into the file, and say `input=COL:1`. If another column has the "
        "direction, say `input=COL*SIGN:UNIT`."
    )
    return [warning("input-rests-off-zero", sentence, parameters=("gain", "offset_voltage"))]


def _rests_at_lowest(data: Dataset) -> bool:
    """Whether the shaft stands under the lowest inputs, where an amplifier in locked antiphase drives it backwards."""
    u, speed = data.input_at_output, np.abs(smooth_speed(data))
    lowest = u <= data.u.min() + _LOWEST * np.ptp(data.u)
    return bool(lowest.sum() >= _FEW and np.median(speed[lowest]) < _STANDS * np.percentile(speed, 95))


def is_duty(data: Dataset) -> bool:
    """Return whether the input is a duty, or was one before it was multiplied by a supply."""
    return data.input_unit in {"%", "1"} or any(finding.code in _DUTY for finding in data.findings)


DOUBTS.member("resting_value")(Doubt(codes=("input-rests-off-zero",), about_fit=_about_fit))
