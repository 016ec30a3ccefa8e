"""A structure behind the filter of a random torque."""

from __future__ import annotations

from servobench.identification.estimators.base import ESTIMATORS
from servobench.identification.estimators.disturbance import (
    Disturbance,
    WhitenedStructure,
    blocks_of,
)
from servobench.identification.estimators.least_squares import minimise
from servobench.identification.models.base import STRUCTURES
from servobench.identification.models.turning import Sliding
from tests.datasets import dataset


def test_a_search_behind_a_filter_made_for_a_far_longer_time_constant_ends_a_hundredth_of_it_away() -> None:
    """A motor of 0.1 s behind a filter for 50 s: the search goes as far as that filter means anything, and no farther."""
    structure, data = STRUCTURES["first_order"], (dataset(seed=1, kind="prbs"),)
    fit = ESTIMATORS["output_error"].fit(structure, data)
    noise = Disturbance.from_memory(0.1, 50.0, "position", data[0].sample_time)
    blocks = (blocks_of(data[0], Sliding.all_through(data[0].t_output), data[0].sample_time),)
    model = WhitenedStructure(structure, noise, data, blocks)
    at = fit.model.names.index("time_constant")
    start = fit.vector
    start[at] = 50.0

    lower, _ = model.bounds(data)
    end = minimise(model, model.whitened_data, start)

    assert lower[at] == 0.5
    assert end.theta[at] == 0.5
    # The bound of the structure itself is left alone.
    assert structure.bounds(data)[0][at] < 0.01 * fit["time_constant"].value
