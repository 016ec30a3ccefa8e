"""Is it measurement noise at all? A score test for the wandering caused by a random torque."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.disturbance import Blocks, Linearisation, blocks_of, longest_block
from servobench.identification.estimators.interval.bins import Bins, expected_information
from servobench.identification.estimators.interval.search import Near
from servobench.identification.estimators.least_squares import Layout
from servobench.identification.models.turning import Sliding

_SILENT = 0.01  # of a usual sample's information: a block with less is left out


def wander_ratio(layout: Layout, near: Near, all_bins: Sequence[Bins], s: float, tau: float) -> float:
    """Return the likelihood ratio for a random torque behind the scores, with noise s and a time constant τ [s].

    Near the maximum a block of samples says as much as a measured position off the prediction by Σ score / Σ information, of
    variance 1 / Σ information, the information being that expected where the shaft was: then a block in which nothing came
    near an edge weighs next to nothing. These are compared with a wandering speed like any other positions. Unlike the
    residuals behind an encoder they are white where nothing wanders, so that a ratio above 5.41 has a chance of 1 in 100: half
    of a χ² of one degree of freedom, as no torque is on the edge of what can be (Self and Liang 1987).
    """
    expected = _expected_information(near, all_bins, s)
    usual = float(np.mean(np.concatenate(expected)))
    blocks, columns = [], []
    for record, j, place, bins, informs in zip(
        layout.data, near.jacobians, near.places, all_bins, expected, strict=True
    ):
        sliding = layout.structure.sliding(near.theta[place], record)
        block = blocks_of(record, sliding, longest_block(None, tau, record))
        sums = np.add.reduceat(np.column_stack([bins.score, j * informs[:, None]]), block.starts)
        weight = np.add.reduceat(informs, block.starts) / usual
        keep = weight > _SILENT
        columns.append(sums[keep] / (weight[keep, None] * np.sqrt(usual)))
        weighed = weight[keep]
        of_kept = Sliding(left=block.sliding.left[keep], turns=block.sliding.turns[keep])
        blocks.append(Blocks(block.starts[keep], weighed, block.times[keep], of_kept, 1 / weighed))
    records = Linearisation(
        blocks=tuple(blocks),
        columns=tuple(columns),
        places=near.places,
        free=near.free,
        kind="position",
        sample_time=max(record.sample_time for record in layout.data),
    )
    return _ratio_for_disturbance(records, tau)


def _ratio_for_disturbance(records: Linearisation, tau: float) -> float:
    """The likelihood ratio of the likeliest disturbance over none, for measurement noise of unit variance."""
    freedom = max(sum(len(b.counts) for b in records.blocks) - int(np.count_nonzero(records.free)), 1)

    def deviance(ratio: float) -> float:
        trial = records.under(tau, ratio)
        # There the variance of the noise is the likeliest one; here it is known.
        return freedom * (trial.variance - float(np.log(trial.variance))) + trial.deviance

    levels = records.levels(tau)
    costs = [deviance(float(np.exp(level))) for level in levels]
    middle, step = float(levels[int(np.argmin(costs))]), float(abs(levels[1] - levels[0]))
    costs += [deviance(float(np.exp(middle + part * step))) for part in (-0.5, -0.25, 0.25, 0.5)]
    return max(deviance(0.0) - min(costs), 0.0)


def _expected_information(near: Near, all_bins: Sequence[Bins], s: float) -> list[Array]:
    """The information of each sample (M,) that is to be expected where the prediction puts it, whichever bin it falls into.

    From s = Q/2 on it is the same everywhere to a hundredth, and is taken from the samples.
    """
    flat = float(np.mean(np.concatenate([bins.information for bins in all_bins])))
    return [
        np.full(len(x), flat) if s > 0.5 * quantum else expected_information(x, quantum, s)
        for x, quantum in zip(near.offsets, near.quanta, strict=True)
    ]
