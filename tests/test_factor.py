"""A gain off by a usual factor is told, and one that isn't known is held against nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.doubts.factor import _about_nominal
from servobench.identification import identify
from servobench.measurement.measure import measure
from servobench.motor.parameters import data_sheet
from tests.test_written import recorded, same


def test_a_gain_in_revolutions_per_minute_is_told_where_it_is_known() -> None:
    data = measure(recorded(same(0.0)))
    minutes = replace(data, y=data.y * 60 / (2 * np.pi))
    fit = identify(minutes, structure="first_order", estimator="output_error").fit
    assert fit is not None
    motor = data_sheet("qube_servo_2").motor
    covariance = fit.covariance.copy()
    at = fit.model.names.index("gain")
    covariance[at, at] = fit.model["gain"] ** 2

    assert [finding.code for finding in _about_nominal(fit, motor)] == ["factor-off"]
    assert _about_nominal(replace(fit, covariance=covariance), motor) == []
