"""The rule that ends a run which misses more than a tenth of the ticks of half a second."""

import numpy as np
import pytest

from servobench.core.channels import Sample
from servobench.rig.clock import Tick
from servobench.rig.devices.guarded import Guarded
from servobench.rig.loop.missed_ticks import MissedFault, MissedTickRule
from servobench.rig.loop.place import Place
from tests.rig.loop.shaft import Shaft


def place(index: int) -> Place:
    tick = Tick(
        index=index,
        scheduled=index * 0.002,
        actual=0.0,
        late=False,
        sample=Sample(index=index, time=0.0, counts=0),
    )
    return Place(tick=tick, reference=0.0, commanded=0.0, applied=0.0, saturated=False)


@pytest.mark.promise("S32")
def test_it_counts_the_missed_ticks_of_the_window_whatever_came() -> None:
    """Truth: all ticks of the window, looked at one by one."""
    random = np.random.default_rng(3)
    for _ in range(50):
        rule = MissedTickRule(0.01, share=1.0, window=0.3)  # 30 ticks
        done: list[int] = []
        index = -1
        for _ in range(200):
            index += 1 + int(random.integers(0, 40) * (random.random() < 0.2))
            done.append(index)

            expected = sum(k not in set(done) for k in range(max(0, index - 29), index + 1))
            assert rule.count(index) == expected


@pytest.mark.promise("S32")
@pytest.mark.parametrize(("missed", "ends"), [(25, False), (26, True)])
def test_more_than_a_tenth_in_half_a_second_ends_the_run(missed: int, ends: bool) -> None:
    rule = MissedTickRule(0.002)  # 250 ticks
    said = [rule(place(k)) for k in range(1000)]
    after = rule(place(1000 + missed))

    assert said == [None] * 1000
    assert (after is not None) == ends
    if after is not None:
        assert after.reason == "fault"
        assert after.sentence.startswith("26 of the last 250 ticks (0.5 s) were missed at 2.052 s")


def test_single_missed_ticks_add_up_within_the_window_and_are_forgotten_after_it() -> None:
    every_tenth, every_ninth = MissedTickRule(0.002), MissedTickRule(0.002)

    assert all(every_tenth(place(k)) is None for k in range(100_000) if k % 10)
    assert not all(every_ninth(place(k)) is None for k in range(1000) if k % 9)


def test_with_long_ticks_one_missed_tick_does_not_end_a_run_and_two_do() -> None:
    rule = MissedTickRule(0.2)  # half a second is two ticks and a half

    assert [rule(place(k)) for k in (0, 1, 3, 4)] == [None] * 4
    assert rule(place(6)) is not None


class Drive:
    """The drive, as far as the rule needs it."""

    enabled = True


@pytest.mark.promise("S32")
def test_where_faults_are_held_too_many_missed_ticks_are_one_and_what_was_missed_before_does_not_count_again() -> (
    None
):
    guarded = Guarded(Shaft(), when_faulted="hold")  # type: ignore[arg-type]
    guarded.start(0.002, 0)
    fault = MissedFault(MissedTickRule(0.002), guarded, Drive())  # type: ignore[arg-type]

    def done(index: int) -> float:
        guarded.read()
        applied = guarded.write(1.0)
        assert fault(place(index)) is None
        return applied

    assert [done(k) for k in (0, 1, 27)] == [1.0] * 3  # 25 missed, a tenth
    assert guarded.fault is None
    assert done(29) == 1.0  # and one more
    assert guarded.fault is not None
    assert guarded.fault.code == "ticks-missed"
    assert "26 of the last 250 ticks" in guarded.fault.sentence
    assert "the voltage is set to zero" in guarded.fault.sentence
    assert done(30) == 0.0
    assert done(130) == 0.0  # while it is held nothing is driven
    guarded.acknowledge()
    assert [done(k) for k in (131, 157)] == [1.0] * 2
    assert guarded.fault is None
    assert done(159) == 1.0
    assert guarded.fault is not None


def test_ticks_that_are_missed_while_nothing_is_driven_are_no_fault() -> None:
    guarded = Guarded(Shaft(), when_faulted="hold")  # type: ignore[arg-type]
    guarded.start(0.002, 0)
    drive = Drive()
    drive.enabled = False
    fault = MissedFault(MissedTickRule(0.002), guarded, drive)  # type: ignore[arg-type]

    assert [fault(place(k)) for k in (0, 100, 200)] == [None] * 3
    drive.enabled = True
    assert fault(place(201)) is None
    assert guarded.fault is None
