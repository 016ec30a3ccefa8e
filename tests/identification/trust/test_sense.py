"""A motor that turns against its input is told, where the sign of its gain is known."""

from __future__ import annotations

import numpy as np
import pytest

from servobench.identification.trust.doubts.base import DOUBTS
from tests.report.makers import fit_of


@pytest.mark.parametrize(("gain", "sd", "told"), [(-2.0, 0.5, True), (-2.0, 1.5, False), (2.0, 0.5, False)])
def test_only_a_sign_that_is_known_is_reported(gain: float, sd: float, told: bool) -> None:
    fit = fit_of((gain, 0.1, 0.3, 0.002), np.diag([sd**2, 1e-6, 1e-4, 1e-8]))

    assert [each.code for each in DOUBTS["sense"].about_fit(fit)] == ["sign-negative"] * told
