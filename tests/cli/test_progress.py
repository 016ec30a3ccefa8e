"""A command's progress messages are true, and appear only if they are wanted."""

import io
from threading import Event, Lock, Thread

import numba
import pytest

from servobench.cli.progress import Progress, announce_compiling, duration


class Clock:
    """A clock that stands where it was put [s]."""

    def __init__(self) -> None:
        self.time = 100.0

    def __call__(self) -> float:
        return self.time


@pytest.fixture
def clock() -> Clock:
    return Clock()


def test_nothing_is_said_within_the_first_second(clock: Clock) -> None:
    progress = Progress(stream=io.StringIO(), now=clock)
    progress.begin("running")
    clock.time += 0.9
    progress.advance(0.5)

    assert progress.line() == ""


def test_the_time_left_is_reported_from_the_pace_so_far(clock: Clock) -> None:
    progress = Progress(stream=io.StringIO(), now=clock)
    progress.begin("running")
    clock.time += 3.0  # compiling; no part of the pace
    progress.advance(0.0)
    clock.time += 2.0
    progress.advance(0.2)

    assert progress.line() == "running, 20 %, 8 s left"

    clock.time += 1.0
    assert progress.line() == "running, 20 %, 7 s left"

    clock.time += 60.0
    assert progress.line() == "running, 20 %, 0 s left"


def test_a_run_in_real_time_has_its_own_time_left_whatever_its_start_took(clock: Clock) -> None:
    progress = Progress(stream=io.StringIO(), now=clock)
    progress.begin("running")
    progress.advance(0.0, 3.0)
    clock.time += 5.0  # a start, or a wait, that is no part of the run
    progress.advance(0.17, 2.5)

    assert progress.line() == "running, 17 %, 2 s left"


def test_after_an_alarm_nothing_is_reported_as_going_on(clock: Clock) -> None:
    stream = io.StringIO()
    progress = Progress(stream=stream, now=clock)
    progress.begin("running")
    progress.advance(0.5, 10.0)
    clock.time += 2.0
    assert progress.line() == "running, 50 %, 10 s left"

    progress.alarm("SWITCH OFF THE SUPPLY")

    assert progress.line() == ""


def test_where_nothing_tells_the_pace_the_time_so_far_is_reported(clock: Clock) -> None:
    progress = Progress(stream=io.StringIO(), now=clock)
    progress.begin("identifying")
    clock.time += 75.0

    assert progress.line() == "identifying, 1 min 15 s so far"

    progress.advance(0.0)
    assert progress.line() == "identifying, 1 min 15 s so far"


def test_short_work_leaves_no_trace() -> None:
    stream = io.StringIO()

    with Progress(stream=stream) as progress:
        progress.begin("reading")
        progress.advance(0.5)

    assert stream.getvalue() == ""


class Screen(io.StringIO):
    """A terminal that tells when it was written to a second time."""

    def __init__(self) -> None:
        super().__init__()
        self.writes = 0
        self.second = Event()

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        self.writes += 1
        if self.writes == 2:
            self.second.set()
        return super().write(text)


def test_each_work_has_its_own_time(clock: Clock) -> None:
    progress = Progress(stream=io.StringIO(), now=clock)
    progress.begin("running")
    clock.time += 10.0
    progress.advance(1.0)
    progress.begin("identifying")
    assert progress.line() == ""

    clock.time += 2.0
    assert progress.line() == "identifying, 2 s so far"


class Log(io.StringIO):
    """A file that tells when it was written to."""

    def __init__(self) -> None:
        super().__init__()
        self.written = Event()

    def flush(self) -> None:
        self.written.set()


def test_a_file_gets_one_line_for_each_work(clock: Clock) -> None:
    log = Log()

    with Progress(stream=log, now=clock) as progress:
        for what in ("running", "identifying"):
            log.written.clear()
            progress.begin(what)
            clock.time += 5.0
            assert log.written.wait(timeout=60)

    assert log.getvalue() == "running, 5 s so far\nidentifying, 5 s so far\n"


def test_a_terminal_is_left_clean() -> None:
    screen, clock = Screen(), Clock()

    with Progress(stream=screen, now=clock) as progress:
        progress.begin("running")
        clock.time += 10.0
        assert screen.second.wait(timeout=60)

    text = "running, 10 s so far"
    assert screen.getvalue() == f"\r{text}\r{text}\r{'':{len(text)}}\r"


def test_a_terminal_that_is_gone_ends_no_work() -> None:
    screen = Screen()
    screen.close()

    with Progress(stream=screen) as progress:
        progress.begin("running")
        progress.advance(1.0)


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (0.4, "0 s"),
        (59.4, "59 s"),
        (59.6, "1 min 0 s"),
        (3599, "59 min 59 s"),
        (3600, "1 h 0 min"),
        (7500, "2 h 5 min"),
    ],
)
def test_a_duration_is_reported_as_people_do(seconds: float, said: str) -> None:
    assert duration(seconds) == said


def test_compiling_is_reported_once_and_only_when_something_is_compiled(
    capsys: pytest.CaptureFixture[str],
) -> None:
    @numba.njit
    def twice(x):  # type: ignore[no-untyped-def]
        return 2 * x

    @numba.njit
    def thrice(x):  # type: ignore[no-untyped-def]
        return 3 * x

    progress = Progress(stream=io.StringIO())
    with announce_compiling(progress):
        twice(1.0)
        thrice(1.0)
    first = capsys.readouterr().err
    with announce_compiling(progress):
        twice(1.0)

    assert first.count("compiling") == 1
    assert capsys.readouterr().err == ""


def test_ctrl_c_while_the_thread_starts_is_ctrl_c(monkeypatch: pytest.MonkeyPatch) -> None:
    """Python's lock fails in its place: "release unlocked lock"."""

    def interrupted(thread: Thread) -> None:
        try:
            raise KeyboardInterrupt
        finally:
            Lock().release()

    monkeypatch.setattr(Thread, "start", interrupted)
    with pytest.raises(KeyboardInterrupt), Progress(stream=io.StringIO()):
        pass
