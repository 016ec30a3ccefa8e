"""Sixteen numbers side by side in vector registers, for kernels that compute as many motors at a time.

An array that a compiled function makes lies on the heap, where the processor has to load and store it at every step. Room on the
stack of a fixed size can stay in registers for a whole loop (docs/decisions/0059-ensembles.md).
"""

from __future__ import annotations

from collections.abc import Callable

from servobench.core.channels import Array
from servobench.core.compiled import stack_room

LANES = 16
"""Motors that are computed side by side: two registers of eight for each variable, whose sums don't wait for each other."""

_ALIGNMENT = 64  # bytes, a register's

lanes: Callable[[], Array] = stack_room(LANES, _ALIGNMENT)
"""Room for sixteen numbers (LANES,) in a compiled function, with nothing in them yet."""
