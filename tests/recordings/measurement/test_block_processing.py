"""Blocks one after the other give what the stages give sample by sample."""

from __future__ import annotations

import numpy as np
import pytest

from servobench.recordings.measurement.base import STAGES, Chain, fold
from servobench.recordings.measurement.block_processing import Blockwise, process_block

TEXTS = [text for name in STAGES.names() for text in STAGES[name].examples]
CHAINS = ["", "derivative | lowpass 50 rad/s", "unwrap 16 bit | derivative | lowpass 8 Hz euler | delay 5 ms"]


def record(samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Whole numbers that wander and wrap, at times that aren't even."""
    rng = np.random.default_rng(5)
    t = np.cumsum(rng.uniform(0.0005, 0.003, samples))
    return np.cumsum(rng.integers(-900, 1200, samples)) % 65536.0, t


@pytest.mark.parametrize("text", [*TEXTS, *CHAINS])
@pytest.mark.parametrize("sizes", [(1, 1, 2, 0, 3, 100), (400,), (33, 34, 33)], ids=str)
def test_blocks_continue_each_other(text: str, sizes: tuple[int, ...]) -> None:
    chain = Chain.parse(text)
    x, t = record(sum(sizes))
    dt = np.diff(t, prepend=t[0])
    state, at, out = chain.start(), 0, []
    for size in sizes:
        state, y = process_block(chain, state, x[at : at + size], dt[at : at + size])
        out.append(y)
        at += size

    # Nothing but rounding lies between the two: of values up to 65536 / 0.5 ms, in sums of a few hundred.
    np.testing.assert_allclose(np.concatenate(out), fold(chain, x, t), rtol=1e-9, atol=1e-6)


def test_the_stages_of_the_usual_chain_take_a_block_at_once() -> None:
    for text in ("derivative", "lowpass 50 rad/s", "unwrap 16 bit"):
        assert isinstance(Chain.parse(text).stages[0], Blockwise)
