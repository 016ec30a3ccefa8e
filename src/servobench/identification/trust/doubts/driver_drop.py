"""A friction that is large for a motor, under a duty times the supply: a part of it may be lost in the driver.

A bridge of bipolar transistors drops 1.4 to 3 V in the direction of the current, whatever the duty. As long as the motor is
driven that is the same as Coulomb friction. Source: the saturation voltages in the data sheet of the L298 (STMicroelectronics
2000).
"""

from __future__ import annotations

import numpy as np

from servobench.core.finding import Finding, info
from servobench.core.rounding import with_unit
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.identification.trust.doubts.resting_value import is_duty

_LARGE = 0.1  # of the largest input: a motor alone loses less, mostly
_DROP = 0.8  # V: less is no drop of two transistors


def _about(fit: Fit) -> list[Finding]:
    if not all(is_duty(record.data) for record in fit.records):
        return []
    if "coulomb_voltage" not in fit.model.names or fit.unit("coulomb_voltage") != "V":
        return []
    lost = abs(float(fit.model["coulomb_voltage"]))
    largest = max(float(np.abs(record.data.u).max()) for record in fit.records)
    if lost < max(_DROP, _LARGE * largest):
        return []
    sentence = (
        f"{with_unit(lost, 'V', 2)} of the input is lost before it moves the motor, and not all of that need be friction: the "
        "input is the duty times the supply, and a bridge of bipolar transistors, such as an L298, keeps about 2 V for itself. "
        "Record the voltage at the motor to tell the two apart."
    )
    return [info("driver-drop-possible", sentence, parameters=("coulomb_voltage",))]


DOUBTS.member("driver_drop")(Doubt(codes=("driver-drop-possible",), about_fit=_about))
