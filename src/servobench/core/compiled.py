"""A typed wrapper of Numba: how the kernels of this package are compiled."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, TypeVar, cast

import numba
from llvmlite import ir
from numba.core import types
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.cgutils import alloca_once
from numba.core.event import Event, Listener, register, unregister
from numba.core.runtime.nrt import rtsys
from numba.extending import intrinsic

from servobench.core.kernel_sources import source_stamp

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile a numeric function to machine code at its first call, and keep the code on disk for the next process.

    Only contraction to fused multiply-adds is allowed: NaN and infinity keep their meaning. Where the code can't be kept, or
    what was kept can't be read, it is compiled anew; one warning a process says so, to the logger "servobench".
    """
    return _compile(function, fastmath={"contract"}, _nrt=True, forceinline=False)


def strictly_compiled(function: F) -> F:
    """Compile as `compiled` does, with each operation rounded by itself: the results are those of Python, bit for bit.

    Such a function makes no arrays; so none is counted, which would take several times as long as a tick's arithmetic.
    """
    return _compile(function, fastmath=set(), _nrt=False, forceinline=False)


def strictly_inlined(function: F) -> F:
    """Compile as `strictly_compiled` does, as a part of each kernel that calls it."""
    return _compile(function, fastmath=set(), _nrt=False, forceinline=True)


def loosely_compiled(function: F) -> F:
    """Compile as `compiled` does, for values that are finite all the way: what NaN does to a result isn't defined.

    A minimum is then one instruction, and loops over lanes become vectors.
    """
    return _compile(function, fastmath={"contract", "nsz", "nnan"}, _nrt=True, forceinline=False)


def stack_room(size: int, alignment: int = 8) -> Callable[[], Any]:
    """Return what a kernel calls for room for so many numbers of its own: without a length, and not cleared.

    Where each index is a constant the numbers stand in registers, unlike those of an array, which others may see. Where
    nothing is compiled it is a list. `alignment` is that of the first [bytes].
    """
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        return lambda: [0.0] * size

    def room(typing: Any) -> Any:

        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            numbers = cast(Any, alloca_once)(builder, ir.ArrayType(ir.DoubleType(), size))
            numbers.align = alignment
            return builder.bitcast(numbers, ir.DoubleType().as_pointer())

        return cast(Any, types.CPointer)(types.float64)(), codegen

    return cast(Callable[[], Any], cast(Any, intrinsic)(room))


def _compile(function: F, **options: Any) -> F:
    dispatcher = numba.njit(nogil=True, error_model="numpy", **options)(function)
    try:
        cast(Any, dispatcher)._cache = _Cache(function)
    except (RuntimeError, OSError):  # no folder that can be written to, or one that can't be examined
        _warn("compiled code can't be kept, as neither the package nor the home folder can be written to")
    return cast(F, dispatcher)


class _Cache(FunctionCache):
    """Numba's cache of one function, which may fail: no result depends on it. A change of any kernel that it calls renews it."""

    def __init__(self, function: Callable[..., object]) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]
        stamp = source_stamp(function.__module__) or self._impl.locator.get_source_stamp()
        self._cache_file = cast(Any, IndexDataCacheFile)(self._cache_path, self._impl.filename_base, stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what was kept, None if there is nothing or it can't be read; a damaged index is replaced."""
        try:
            # Numba would load here all that compiling may need, a quarter of a second's work; a compiler loads it by itself, and
            # code that is there needs only what it calls: memory for arrays.
            rtsys.initialize(target_context)
            with self._guard_against_spurious_io_errors():
                overload = self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]
            if overload is None:
                _announce()
            return overload
        except Exception as error:  # pickle: what stands in a damaged file may raise anything
            _warn(f"compiled code in {self.cache_path} can't be read ({_reason(error)})")
            with suppress(OSError):
                self.flush()  # type: ignore[no-untyped-call]
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep compiled code for the next process, where that can be done."""
        try:
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]
        except Exception as error:  # it reads the index as well
            _warn(f"compiled code can't be kept in {self.cache_path} ({_reason(error)})")


def _reason(error: Exception) -> str:
    return (getattr(error, "strerror", None) or str(error) or type(error).__name__).rstrip(".")


class _Warning:
    """The one warning of a process: each of a hundred kernels would say the same."""

    given = False


def _warn(what: str) -> None:
    if not _Warning.given:
        _Warning.given = True
        logging.getLogger("servobench").warning(
            "%s; it is compiled again, which takes longer. Set NUMBA_CACHE_DIR to another folder for it.",
            what,
        )


class _Announcement:
    """The one announcement of a process; `elsewhere` counts those who announce it themselves."""

    given = False
    elsewhere = 0


def _announce() -> None:
    """Tell a Python caller that this call takes long, and that the next ones won't."""
    if code_is_kept() and not _Announcement.given and not _Announcement.elsewhere:
        _Announcement.given = True
        logging.getLogger("servobench").warning("compiling the numeric kernels; this is done once and kept")


@contextmanager
def keep_announcement_quiet() -> Iterator[None]:
    """Don't tell meanwhile that kernels are compiled, for a caller that tells it in its own way."""
    _Announcement.elsewhere += 1
    try:
        yield
    finally:
        _Announcement.elsewhere -= 1


def code_is_kept() -> bool:
    """Return whether nothing has kept compiled code from being kept so far."""
    return not _Warning.given


@contextmanager
def announce_compilations(begun: Callable[[int], None], over: Callable[[], None]) -> Iterator[None]:
    """Tell meanwhile of each kernel that isn't on the disk yet, and is compiled: when that begins, and when it is over.

    `begun` gets how many were compiled before. Kernels that call others are compiled after those: `over` is told after the last.
    """
    watching = _CompilationListener(begun, over)
    register("numba:compile", watching)  # type: ignore[no-untyped-call]
    try:
        with keep_announcement_quiet():
            yield
    finally:
        unregister("numba:compile", watching)  # type: ignore[no-untyped-call]


class _CompilationListener(Listener):
    """Hears of compilations, one within the other."""

    def __init__(self, begun: Callable[[int], None], over: Callable[[], None]) -> None:
        self._begun = begun
        self._over = over
        self._depth = self._done = 0

    def on_start(self, event: Event) -> Any:
        """One begins."""
        self._begun(self._done)
        self._depth += 1

    def on_end(self, event: Event) -> Any:
        """One ends, whether it went well or not."""
        self._depth -= 1
        self._done += 1
        if self._depth == 0:
            self._over()
