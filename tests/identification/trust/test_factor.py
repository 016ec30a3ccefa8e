"""A gain off by a usual factor is told, and one that isn't known is held against nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.identification.identify import identify
from servobench.identification.trust.doubts.base import DOUBTS
from servobench.identification.trust.doubts.factor import _about_nominal
from servobench.recordings.measurement.measure import measure
from servobench.rig.motor.parameters import data_sheet
from tests.datasets import QUANTUM, dataset
from tests.identification.test_written import recorded, same
from tests.rig.motor.reference import Truth, march


def test_a_gain_in_revolutions_per_minute_is_reported_where_it_is_known() -> None:
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


def test_a_factor_in_the_counts_shows_in_the_back_emf_at_one_level() -> None:
    """One step of 3 V from rest, (u - R i)/k is the speed: half of it where the counts in a turn are twice what they are."""
    sheet = data_sheet("qube_servo_2").motor
    u = np.full(2000, 3.0)
    out = march(Truth(), u, 0.002)
    right = dataset(seed=1, samples=len(u), u=u, y=np.round(out[:, 2] / QUANTUM) * QUANTUM)
    right = replace(right, input_before=3.0, current=out[:, 0])
    halved = replace(right, y=0.5 * right.y, quantum=0.5 * QUANTUM)

    found = [each for each in identify(halved, nominal=sheet).findings if each.code == "factor-off"]

    assert len(found) == 1
    assert "2 times smaller than the back-emf" in found[0].sentence
    assert "factor-off" not in {each.code for each in identify(right, nominal=sheet).findings}


def test_a_current_that_nobody_wrote_shows_no_factor() -> None:
    sheet = data_sheet("qube_servo_2").motor
    u = np.full(2000, 3.0)
    y = 0.5 * march(Truth(), u, 0.002)[:, 2]
    data = replace(dataset(seed=1, samples=len(u), u=u, y=y), current=np.full(len(u), 1e-63))

    assert DOUBTS["factor"].beside_nominal([data], sheet) == []
