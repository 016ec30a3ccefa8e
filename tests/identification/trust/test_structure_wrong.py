"""A residual that goes on from sample to sample is a motion that the model lacks; one that alternates is the sensor's."""

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.finding import info
from servobench.identification.trust.doubts.structure_wrong import DOUBTS
from tests.contracts.finding_examples.base import sound_fit

N = 2000
SLOW = np.sin(2 * np.pi * np.arange(N) / 400)
RIPPLE = np.where(np.arange(N) % 2, 1.0, -1.0)
ROUNDING = np.random.default_rng(2).uniform(-1.2, 1.2, N + 2)
CENTRAL = ROUNDING[2:] - ROUNDING[:-2]
"""What rounding leaves of a speed that is the next count minus the last one."""


@pytest.mark.parametrize(("left", "codes"), [(SLOW, ["structure-wrong"]), (RIPPLE, []), (CENTRAL, [])])
def test_only_a_motion_is_a_wrong_structure(left: np.ndarray, codes: list[str]) -> None:
    """What is left is two fifths of the output, and neither noise model explains it."""
    (record,) = sound_fit().records
    output = SLOW[::-1] + 1.5 * np.cos(2 * np.pi * np.arange(N) / 300)
    data = replace(record.data, y=output, quantum=None)
    fit = replace(
        sound_fit(),
        records=(
            replace(record, data=data, prediction=output - left, residual=left, valid=np.ones(N, bool)),
        ),
        findings=(info("weighed-twice", "Neither noise model fits."),),
    )

    assert fit.fit_percent < 80
    assert [each.code for each in DOUBTS["structure_wrong"].about_fit(fit)] == codes


@pytest.mark.parametrize(("speed", "codes"), [(60.0, []), (5.0, ["structure-wrong"])])
def test_a_ripple_that_is_small_beside_the_speed_is_no_other_structure(
    speed: float, codes: list[str]
) -> None:
    """A record that turns at one speed nearly all the time has little else to be explained."""
    (record,) = sound_fit().records
    data = replace(record.data, y=speed + 1.2 * SLOW, quantum=None, kind="speed", output_unit="rad/s")
    fit = replace(
        sound_fit(),
        records=(
            replace(record, data=data, prediction=data.y - SLOW, residual=SLOW, valid=np.ones(N, bool)),
        ),
        findings=(info("weighed-twice", "Neither noise model fits."),),
    )

    assert fit.fit_percent < 80
    assert [each.code for each in DOUBTS["structure_wrong"].about_fit(fit)] == codes
