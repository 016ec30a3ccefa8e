"""The typed face of Numba: how the kernels of this package are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile a numeric function to machine code at its first call, and keep the code on disk for the next process.

    Only contraction to fused multiply-adds is allowed: NaN and infinity keep their meaning.
    """
    return cast(F, numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})(function))
