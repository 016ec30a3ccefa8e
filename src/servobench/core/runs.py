"""Samples that follow each other and have something in common."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def runs(which: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the runs of samples that are true: the index of the first one, and of the one behind the last.

    :param which: whether each sample is meant, (N,)
    :return: a pair for each run, in their order

    >>> import numpy as np
    >>> runs(np.array([True, True, False, True]))
    [(0, 2), (3, 4)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([False], which, [False])).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
