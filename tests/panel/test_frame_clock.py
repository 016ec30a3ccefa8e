"""The beat: thirty moments a second that processes agree on, each taken once."""

from itertools import pairwise

import pytest

from servobench.panel import frame_clock
from servobench.panel.frame_clock import FRAMES, FrameClock


class Clock:
    """A time that a test moves."""

    now = 100.0

    def perf_counter(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(frame_clock, "time", made)
    return made


def moments(clock: Clock, lead: float, count: int) -> list[float]:
    """The times at which somebody wakes who sleeps as long as he is told."""
    one, found = FrameClock(lead), []
    for _ in range(count):
        clock.now += one.wait()
        found.append(clock.now)
    return found


def test_who_comes_later_wakes_at_the_same_moments(clock: Clock) -> None:
    first = moments(clock, 0.0, 10)
    clock.now = first[4] + 0.4 / FRAMES

    # What is left of a double at 100 s is 1e-14 s.
    assert moments(clock, 0.0, 5) == pytest.approx(first[5:], abs=1e-12)
    assert [after - before for before, after in pairwise(first)] == pytest.approx([1 / 30] * 9)


def test_a_lead_is_before_the_moment(clock: Clock) -> None:
    plain = moments(clock, 0.0, 3)
    clock.now = plain[0]

    assert moments(clock, 0.006, 2) == pytest.approx([moment - 0.006 for moment in plain[1:]], abs=1e-12)


def test_moments_that_are_missed_are_left_out_and_none_is_taken_twice(clock: Clock) -> None:
    one = FrameClock()
    clock.now += one.wait()
    before = clock.now
    clock.now += 2.5 / FRAMES
    clock.now += one.wait()

    assert clock.now - before == pytest.approx(3 / FRAMES)
    assert one.wait() == pytest.approx(1 / FRAMES)  # and not 0, though the moment is now
