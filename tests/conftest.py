"""Fixtures for every test: real recordings if they are available, and the rules that hold under CI."""

import gc
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Generator, Iterator
from fnmatch import fnmatchcase
from itertools import zip_longest
from pathlib import Path
from typing import Any

import hypothesis
import pytest

from tests import long_tests
from tests.busy_computer import pytest_runtest_protocol, pytest_terminal_summary
from tests.kernels import pytest_sessionfinish, pytest_sessionstart, pytest_xdist_node_collection_finished

__all__ = [
    "pytest_runtest_protocol",
    "pytest_sessionfinish",
    "pytest_sessionstart",
    "pytest_terminal_summary",
    "pytest_xdist_node_collection_finished",
]

ROOT = Path(__file__).resolve().parent.parent
REAL_DATA = Path(os.environ.get("SERVOBENCH_REAL_DATA") or ROOT.parent / "shared" / "data")
UNDER_CI = os.environ.get("CI", "").lower() in {"1", "true", "yes"}

# Several files are run at a time. With a thread for each core in each, the linear algebra of 4 x 4 matrices would wait for the
# others: three quarters of a frequency response's fit. NumPy reads it when it is imported, here and in what is started.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# A shell that starts something in the background has it ignore Ctrl-C, and nohup the end of the terminal. The processes that the
# tests start would inherit that, and whoever ignores a signal can't be tested with it.
for name in ("SIGINT", "SIGHUP", "SIGQUIT", "SIGTERM"):
    if hasattr(signal, name) and signal.getsignal(number := getattr(signal, name)) is signal.SIG_IGN:
        signal.signal(number, signal.default_int_handler if name == "SIGINT" else signal.SIG_DFL)

# So would they inherit how words look in the terminal of whoever started the tests, which says nothing of what is said.
for name in ("COLUMNS", "LINES", "FORCE_COLOR", "NO_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
    os.environ.pop(name, None)

# Container images set this, and then each process that a test starts compiles the package's source anew: half of what a short
# command costs.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# While tests are collected there is no garbage, only ever more to go through; pytest_collection_finish enables it.
gc.disable()

# No deadline: the first example of a property compiles the kernels, and a shared machine stalls now and then.
hypothesis.settings.register_profile("local", deadline=None)
# Under CI the same examples every time: a red run is about the change, and can be repeated elsewhere.
hypothesis.settings.register_profile("ci", deadline=None, derandomize=True, print_blob=True)
hypothesis.settings.load_profile("ci" if UNDER_CI else "local")


WAITING = ("stories", "hang", "panel", "docs", "cli", "bench", "faults")
"""Folders of tests that wait for processes and browsers, the longest first."""


def may_take_long(path: Path) -> bool:
    """Whether a file of tests may have some for `make test-long`: it, a fixture of its folder, `coverage` or a list says so."""
    if path.is_relative_to(ROOT) and path.relative_to(ROOT).as_posix() in long_tests.FILES:
        return True
    folders = [folder for folder in path.parents if folder.is_relative_to(ROOT / "tests")]
    beside = [folder / "conftest.py" for folder in folders if folder != ROOT / "tests"]
    return any(
        word in file.read_text(encoding="utf-8")
        for file in (path, *beside)
        if file.is_file()
        for word in ("mark.long", "coverage.RUNS")
    )


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """For `make test-long` read only the files that may have something for it, one in ten."""
    if config.option.markexpr != "long" or collection_path.suffix != ".py":
        return None
    return None if may_take_long(collection_path) else True


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Put files that wait in turns with files that compute, so that neither kind has the processors, or the end, to itself.

    Of each kind those with long tests come first: a process that got such a file last would be the only one at work for minutes.
    Where all files are read, a test that `make test-long` would never come across is an error.
    """
    long_tests.mark_listed(items, config.args)
    long = {item.path for item in items if item.get_closest_marker("long")}
    if missed := sorted(str(path) for path in long if not may_take_long(path)):
        raise pytest.UsageError(
            f"`may_take_long` of tests/conftest.py doesn't see the long tests of {missed}"
        )
    files = list(dict.fromkeys(item.path for item in items))
    folders = {
        path: path.relative_to(ROOT / "tests").parts[0]
        for path in files
        if path.is_relative_to(ROOT / "tests")
    }
    waiting = sorted(
        (path for path in files if folders.get(path) in WAITING),
        key=lambda path: (path not in long, WAITING.index(folders[path])),
    )
    computing = [path for path in files if folders.get(path) not in WAITING]
    computing.sort(key=lambda path: path not in long)
    turns = [path for pair in zip_longest(waiting, computing) for path in pair if path is not None]
    places = {path: place for place, path in enumerate(turns)}
    items.sort(key=lambda item: places[item.path])


def pytest_collection_finish() -> None:
    """Let the collector of garbage leave ten thousand tests alone, which it went through again and again: a sixth of the time."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)
    gc.enable()


@pytest.fixture(scope="session")
def real_data() -> Callable[[str], Path]:
    """Return a function from the name of a real recording, such as "emps/DATA_EMPS.mat", to its path.

    The recordings are other people's and no part of this project. They are looked for in the folder that the
    environment variable SERVOBENCH_REAL_DATA names, else in `../shared/data` beside the checkout. Where that folder
    is absent the test is skipped; where the folder is there and the file is not, the test fails.
    """

    def find(name: str) -> Path:
        if not REAL_DATA.is_dir():
            pytest.skip("real recordings are absent: set SERVOBENCH_REAL_DATA to a folder that holds them")
        path = REAL_DATA / name
        assert path.is_file(), f"no recording called {name} in {REAL_DATA}"
        return path

    return find


def allowed_skips() -> list[tuple[str, str]]:
    """Return the rows of allowed_skips.txt: (pattern of the test's id, pattern of the reason)."""
    lines = (ROOT / "tests" / "allowed_skips.txt").read_text(encoding="utf-8").splitlines()
    rows = [line.partition("|") for line in lines if line.strip() and not line.startswith("#")]
    return [(test.strip(), reason.strip()) for test, _, reason in rows]


def fail_unlisted_skip(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Turn a skip into a failure, unless allowed_skips.txt lists it: a test that nobody runs holds nothing."""
    if not report.skipped or hasattr(report, "wasxfail"):
        return
    said = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
    reason = said.removeprefix("Skipped: ")
    if any(fnmatchcase(report.nodeid, test) and fnmatchcase(reason, why) for test, why in allowed_skips()):
        return
    report.outcome = "failed"
    report.longrepr = (
        f"{report.nodeid} was skipped: {reason}\nNot listed in tests/allowed_skips.txt, so it fails under CI."
    )


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Under CI, hold every test's skip against the list."""
    report = yield
    if UNDER_CI:
        fail_unlisted_skip(report)
    return report


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Under CI, hold the skip of a whole file (`importorskip` at its top) against the list."""
    report = yield
    if UNDER_CI:
        fail_unlisted_skip(report)
    return report


@pytest.fixture(scope="module")
def quick_workers() -> Iterator[None]:
    """Workers of a fleet in forks of a process that has identified a motor; usually each imports all that by itself."""
    from servobench.fleet import pool

    with pytest.MonkeyPatch.context() as patch:
        if "forkserver" in multiprocessing.get_all_start_methods():
            context = multiprocessing.get_context("forkserver")
            context.set_forkserver_preload(["tests.fleet.warm"])
            patch.setattr(pool, "get_context", lambda _: context)
        yield


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium for the tests of a file; it skips where there is none."""
    from tests.panel.browser import chromium

    with chromium() as found:
        yield found
