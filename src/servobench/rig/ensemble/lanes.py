"""Sixteen numbers side by side in vector registers, for kernels that compute as many motors at a time.

An array that a compiled function makes lies on the heap, where the processor has to load and store it at every step. Room on the
stack of a fixed size can stay in registers for a whole loop (docs/decisions/0059-ensembles.md).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from numba.core import types
from numba.extending import intrinsic

from servobench.core.channels import Array

LANES = 16
"""Motors that are computed side by side: two registers of eight for each variable, whose sums don't wait for each other."""

_ALIGNMENT = 64  # bytes, a register's


def _lanes(typing: Any) -> Any:

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        from llvmlite import ir  # type: ignore[import-untyped]

        number = ir.DoubleType()
        with builder.goto_entry_block():
            room = builder.alloca(ir.ArrayType(number, LANES))
        room.align = _ALIGNMENT
        return builder.bitcast(room, number.as_pointer())

    return types.CPointer(types.float64)(), codegen  # type: ignore[no-untyped-call]


lanes: Callable[[], Array] = cast(Any, intrinsic)(_lanes)
"""Room for sixteen numbers (LANES,) in a compiled function, with nothing in them yet."""
