"""As on Windows: no module that only POSIX has, and processes that are spawned rather than forked."""

from __future__ import annotations

import multiprocessing
import pkgutil
import subprocess
import sys
from importlib import import_module
from types import ModuleType

import servobench as sb

# What CPython's documentation marks as available on Unix only, as far as anybody could want it here. `posix` isn't among them:
# on Unix the interpreter itself stands on it.
POSIX_ONLY = ("fcntl", "grp", "pty", "pwd", "resource", "syslog", "termios", "tty")

# The design's, and those that came with the commands of the same name.
VERBS = (
    "bibo", "connect", "identify", "load", "measure", "predict", "reconcile", "residuals", "run", "save", "simulate", "stability",
    "validate", "why",
)  # fmt: skip

CORE = """
import sys
for name in {names!r}:
    sys.modules[name] = None
import os
for name in ("fork", "forkpty", "sched_setscheduler", "sched_setaffinity", "mlockall"):
    if hasattr(os, name):
        delattr(os, name)
import servobench as sb
with sb.connect("twin") as motor:
    recording = sb.run(sb.Experiment(signal=sb.Square(low=1, high=3, frequency=0.4), duration=3), motor)
result = sb.identify(sb.measure(recording))
assert abs(result.fit["gain"].value - 23.6967) < 0.01, result.fit["gain"]
print(result.verdict)
"""


def test_the_core_runs_without_the_modules_that_only_posix_has() -> None:
    done = subprocess.run(
        [sys.executable, "-c", CORE.format(names=POSIX_ONLY)], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout.strip()) == (0, "trusted"), done.stderr


def identified(seed: int) -> float:
    """The gain that a short run on a twin gives; runs in a process of its own."""
    with sb.connect("twin") as motor:
        recording = sb.run(
            sb.Experiment(signal=sb.Square(low=1, high=3, frequency=0.4), duration=3, seed=seed), motor
        )
    fit = sb.identify(sb.measure(recording)).fit
    if fit is None:
        raise ValueError("the run was refused")
    return fit["gain"].value


def test_a_spawned_process_gets_the_same_answer() -> None:
    """Everything that a process is given can be pickled, and nothing depends on what its parent had loaded."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.map(identified, [1, 2]) == [identified(1), identified(2)]


def test_the_public_names_mean_the_same_whatever_was_imported_before() -> None:
    for module in pkgutil.walk_packages(sb.__path__, "servobench."):
        if not module.name.endswith("__main__"):
            import_module(module.name)
    assert [name for name in sb.__all__ if isinstance(getattr(sb, name), ModuleType)] == []
    assert [name for name in VERBS if not callable(getattr(sb, name))] == []
