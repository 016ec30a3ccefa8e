"""A process that writes rows into a ring as fast as compiled code can; `python -m tests.rig.loop.writing NAME ROWS`.

It begins once LOOP_STATE is 1 and sets it to 2 when it has ended. All numbers of row n are n, so that a torn row shows.
"""

import sys
import time

import numpy as np

from servobench.core.compiled import compiled
from servobench.rig.loop.kernels import push_row
from servobench.rig.loop.ring import LOOP_STATE, RowRing
from servobench.rig.loop.segment import Memory


@compiled
def write(memory: Memory, columns: int, rows: int) -> None:
    """Push rows 0, 1, 2, ..."""
    row = np.empty(columns)
    for n in range(rows):
        row[:] = n
        push_row(memory, row)


if __name__ == "__main__":
    with RowRing.attach(sys.argv[1]) as ring:
        write(ring.memory, ring.columns, 0)  # compiled before it counts
        while ring.get(LOOP_STATE) == 0:
            time.sleep(0.001)
        write(ring.memory, ring.columns, int(sys.argv[2]))
        ring.set(LOOP_STATE, 2)
