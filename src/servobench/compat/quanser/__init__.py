"""A stand-in for Quanser's `quanser` package: a virtual QUBE-Servo, so that programs written for the board run without it.

`install` puts it in place, as a context manager or until `uninstall`; `python -m servobench.compat.quanser SCRIPT.py` runs a
program with it. Everything that it shows is verified on simulated hardware only.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from servobench.compat.quanser.motion import Mounted
    from servobench.compat.quanser.session import Bench

__all__ = ["install"]


def install(
    *,
    time: Literal["simulated", "real"] = "simulated",
    mounted: Mounted = "disc",
    settings: Mapping[str, Any] | None = None,
    seed: int | None = 0,
    has_watchdog: bool = True,
    ignore_threads: bool = False,
    quiet: bool = False,
) -> Bench:
    """Install the stand-in for `quanser` in this process, and return it; used in a `with` statement it uninstalls itself.

    `time` is "simulated", where waits take none and `time.sleep`, `time.time`, `perf_counter` and `monotonic` follow the board's
    time, or "real". `mounted` is "disc", or a pendulum that is "hanging", held "upright" by a hand until the motor takes over, or
    "lifted" by one after two seconds. `settings` are those of the twin that differ from the data sheet of the board, in SI units;
    `seed` makes its noise repeatable. `has_watchdog` says whether the boards have one. As soon as the process has
    another thread than now, the wall clock paces simulated time, unless `ignore_threads`, for threads that leave the board alone,
    such as those of servobench's own loop. `quiet` leaves out the lines on standard error.
    Raises `RuntimeError` where it is installed already.

    >>> with install(quiet=True) as bench:
    ...     import numpy as np
    ...     from quanser.hardware import HIL
    ...
    ...     card = HIL("qube_servo2_usb", "0")
    ...     channel, counts = np.array([0], dtype=np.uint32), np.zeros(1, dtype=np.int32)
    ...     card.write_digital(channel, 1, np.array([1], dtype=np.int8))
    ...     card.write_analog(channel, 1, np.array([2.0]))
    ...     card.read_encoder(channel, 1, counts)
    ...     card.close()
    >>> bench.endings[0].voltage, bench.endings[0].is_safe
    (2.0, False)
    """
    from servobench.compat.quanser.session import Bench

    bench = Bench(
        time=time,
        mounted=mounted,
        settings=settings or {},
        seed=seed,
        has_watchdog=has_watchdog,
        ignore_threads=ignore_threads,
        quiet=quiet,
    )
    bench.install()
    return bench
