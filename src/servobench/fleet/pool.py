"""Workers that may die: many files through a few processes, one row for each whatever happens to the process."""

from __future__ import annotations

import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import connection, get_context, parent_process
from typing import Any, Generic, Protocol, TypeVar

from servobench.core.errors import UsageError

T = TypeVar("T")
R = TypeVar("R")
V = TypeVar("V", covariant=True)

_AHEAD = (
    4  # files that are handed out for each worker: enough that none waits, few enough that memory stays flat
)
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


@dataclass(frozen=True)
class Died:
    """In place of a result: the process that worked on it ended, and why as far as is known."""

    reason: str
    """A sentence."""


class Processes(Generic[T, R]):
    """Processes of this machine that call `work` on one thing after the other; `work` and the things must be picklable.

    Each has one thread for linear algebra, so that results don't depend on how many processes there are.
    """

    def __init__(self, work: Callable[[T], R], count: int) -> None:
        self._work = work
        self._count = count
        self._many: ProcessPoolExecutor | None = None
        self._one: ProcessPoolExecutor | None = None

    def __enter__(self) -> Processes[T, R]:
        """Start them; raises `UsageError` where none can be started."""
        self._many = self._start(self._count)
        return self

    def __exit__(self, *error: object) -> None:
        """Let what was begun end, and begin nothing more."""
        for pool in (self._many, self._one):
            if pool is not None:
                pool.shutdown(cancel_futures=True)

    def results(self, things: Iterable[T]) -> Iterator[tuple[T, R | Died]]:
        """Return what `work` makes of each thing, in their order; `Died` for one whose process ended.

        A process that ends takes the others along. What any of them may have had is tried alone, one after the other, until the
        thing that ends a process is found; the others go on as before.
        """
        waiting: deque[tuple[T, Future[R]]] = deque()
        rest = iter(things)
        suspects = 0
        while True:
            while len(waiting) < _AHEAD * self._count and (further := next(rest, None)) is not None:
                waiting.append((further, self._submit(further)))
            if not waiting:
                return
            thing, future = waiting.popleft()
            try:
                result: R | Died = future.result()
            except BrokenExecutor:
                suspects = suspects or 1 + sum(not _is_done(each) for _, each in waiting)
                result = self._alone(thing)
                suspects = 0 if isinstance(result, Died) else suspects - 1
                if not suspects:
                    self._many = self._restart(self._many, self._count)
                    waiting = deque((each, f if _is_done(f) else self._submit(each)) for each, f in waiting)
            yield thing, result

    def _submit(self, thing: T) -> Future[R]:
        if self._many is None:
            raise RuntimeError("the processes aren't started")
        try:
            return self._many.submit(self._work, thing)
        except BrokenExecutor as error:
            broken: Future[R] = Future()
            broken.set_exception(error)
            return broken

    def _alone(self, thing: T) -> R | Died:
        self._one = self._one or self._start(1)
        try:
            return self._one.submit(self._work, thing).result()
        except BrokenExecutor:
            self._one = self._restart(self._one, 1)
            return Died(
                "the process that read it ended, twice: a library crashed, or there wasn't enough memory"
            )

    def _restart(self, pool: ProcessPoolExecutor | None, count: int) -> ProcessPoolExecutor:
        if pool is not None:
            pool.shutdown(cancel_futures=True)
        return self._start(count)

    def _start(self, count: int) -> ProcessPoolExecutor:
        with _one_thread_each():
            pool = ProcessPoolExecutor(count, mp_context=get_context("spawn"), initializer=_begin)
            try:
                # A process is started with a thing to do, and takes over the environment of that moment.
                for each in [pool.submit(_be_ready) for _ in range(count)]:
                    each.result()
            except BrokenExecutor as error:
                raise UsageError(
                    "no worker process can be started; a script of your own has to call this below "
                    '`if __name__ == "__main__":`'
                ) from error
        return pool


class Pending(Protocol[V]):
    """A result that is still being worked out, as a future of Dask's is."""

    def result(self) -> V:
        """Wait for the result and return it; raises what the work raised."""
        ...


class Cluster(Generic[T, R]):
    """The same by workers elsewhere: `submit` is that of a Dask client, which replaces workers that die by itself."""

    def __init__(self, work: Callable[[T], R], submit: Callable[..., Pending[R]], ahead: int) -> None:
        self._work = work
        self._submit = submit
        self._ahead = ahead

    def results(self, things: Iterable[T]) -> Iterator[tuple[T, R | Died]]:
        """Return what `work` makes of each thing, in their order; `Died` for one that ended several workers."""
        waiting: deque[tuple[T, Pending[R]]] = deque()
        for thing in things:
            waiting.append((thing, self._submit(self._work, thing)))
            if len(waiting) >= self._ahead:
                yield self._collect(*waiting.popleft())
        while waiting:
            yield self._collect(*waiting.popleft())

    def _collect(self, thing: T, pending: Pending[R]) -> tuple[T, R | Died]:
        result = _result_or_death(pending)
        if isinstance(result, Died):
            # It may have been there by chance while another thing ended the workers, which has been given up by now.
            result = _result_or_death(self._submit(self._work, thing))
        return thing, result


def _result_or_death(pending: Pending[R]) -> R | Died:
    """What the work made, or that workers ended over it; raises anything else that the work raised."""
    try:
        return pending.result()
    except Exception as error:
        if type(error).__name__ != "KilledWorker":  # Dask's, which isn't imported here
            raise
        return Died("the workers that read it ended: a library crashed, or there wasn't enough memory")


def _is_done(future: Future[Any]) -> bool:
    """Whether a future ended with a result rather than with its process."""
    return future.done() and not future.cancelled() and not isinstance(future.exception(), BrokenExecutor)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Have processes that are started meanwhile compute with one thread each."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _begin() -> None:
    """Begin a worker: Ctrl-C is its parent's business, and it doesn't outlive that."""
    with suppress(ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)


def _be_ready() -> None:
    """Import what a file needs, and show that the process works."""
    import servobench.identification.identify
    import servobench.recordings.loading.load  # noqa: F401
