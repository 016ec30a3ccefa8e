"""The reference is the signal at the time at which a tick was due, whatever the schedule went through."""

import numpy as np

from servobench.core.channels import Array, Sample
from servobench.rig.clock import Tick
from servobench.rig.loop.references import BLOCK, References

STEP = 0.002


def tick(index: int, moved: float = 0.0) -> Tick:
    """A tick that is due later than its number says by so much [s]."""
    sample = Sample(index=index, time=0.0, counts=0)
    due = index * STEP + moved
    return Tick(index=index, scheduled=due, actual=due, late=False, sample=sample)


def time_itself(t: Array) -> Array:
    return t


def test_on_schedule_it_is_the_signal_at_the_tick_bit_for_bit() -> None:
    references = References(time_itself, STEP)

    assert [references.at(tick(k)) for k in range(3 * BLOCK)] == [k * STEP for k in range(3 * BLOCK)]


def test_a_clock_that_loses_its_phase_does_not_stretch_the_signal() -> None:
    """Each late tick moves the schedule by 0.7 ms; a reference by the tick's number would be 70 ms behind after 100 of them."""
    references = References(time_itself, STEP)
    moved, seen, due = 0.0, [], []
    for k in range(3 * BLOCK):
        moved += 0.0007 * (k % 15 == 7)
        seen.append(references.at(tick(k, moved)))
        due.append(k * STEP + moved)

    # The schedule is moved by whole nanoseconds.
    np.testing.assert_allclose(seen, due, rtol=0, atol=0.5e-9)


def test_a_signal_that_comes_later_begins_at_its_first_tick_and_moves_on_with_the_schedule() -> None:
    references = References(time_itself, STEP, tick(40, 0.003))

    assert references.at(tick(40, 0.003)) == 0.0
    np.testing.assert_allclose(references.at(tick(41, 0.004)), STEP + 0.001, rtol=0, atol=0.5e-9)


def test_a_moved_schedule_does_not_cost_a_whole_block_while_the_tick_is_late() -> None:
    asked: list[int] = []

    def counted(t: Array) -> Array:
        asked.append(len(t))
        return t

    references = References(counted, STEP)
    for k in range(100):
        references.at(tick(k, 0.001 * k))

    assert asked[0] == BLOCK
    assert max(asked[1:]) < BLOCK / 10
