"""Every check of a bench, including those of later files and plug-ins: one bench passes, another one fails."""

from collections.abc import Callable
from functools import cache

import pytest

from servobench.rig.commission.acceptance import STATES
from servobench.rig.commission.checks.base import CHECKS, in_order
from tests.rig.commission.benches import (
    Commissioned,
    DeadStallTwin,
    DeadWatchdogTwin,
    EightBitTwin,
    OffsetTwin,
    OneWayTwin,
    SimulatedPerson,
    TurnedTwin,
    commissioned,
)

Example = Callable[[], Commissioned]


@cache
def sound() -> Commissioned:
    """A bench with nothing wrong, of which everything can be told."""
    return commissioned(watchdog=0.05, counter_bits=16)


def turned(counts: float) -> Commissioned:
    TurnedTwin.person = SimulatedPerson(turns=3, counts=counts)
    return commissioned(TurnedTwin, person=TurnedTwin.person, watchdog=0.05)


EXAMPLES: dict[str, tuple[Example, Example]] = {
    "rest": (sound, lambda: commissioned(OffsetTwin)),
    "noise": (sound, lambda: commissioned(current_noise=0.5)),
    "timing": (
        lambda: commissioned(faults=[{"name": "jitter", "largest": "0.2 ms"}]),
        lambda: commissioned(faults=[{"name": "slow_read", "takes": "5 ms", "every": 70}]),
    ),
    "stop": (sound, lambda: commissioned(faults=[{"name": "blocked_shaft"}])),
    "watchdog": (sound, lambda: commissioned(DeadWatchdogTwin)),
    "turns": (lambda: turned(3 * 2048), lambda: turned(3 * 512)),
    "sign": (sound, lambda: commissioned(faults=[{"name": "encoder_flipped"}])),
    "polarity": (sound, lambda: commissioned(OneWayTwin)),
    "dead_band": (sound, lambda: commissioned(coulomb_torque="12 mN·m")),
    "stall": (sound, lambda: commissioned(DeadStallTwin)),
    "delay": (sound, lambda: commissioned(delay="6 ms")),
    "counter": (sound, lambda: commissioned(EightBitTwin)),
}
"""For each check a bench that passes it, and one that fails it."""


def test_every_check_has_an_example_that_passes_and_one_that_fails() -> None:
    assert set(EXAMPLES) == set(CHECKS.names())


@pytest.mark.parametrize("name", CHECKS.names())
@pytest.mark.parametrize(("place", "state"), [(0, "verified"), (1, "failed")])
def test_it_tells_a_sound_bench_from_another(name: str, place: int, state: str) -> None:
    found = EXAMPLES[name][place]()
    outcome = found.outcome(name)

    assert outcome.state == state, outcome
    assert outcome.did.endswith(".")
    assert outcome.expected.endswith(".")
    assert outcome.found.endswith(".")
    assert bool(outcome.remedy) == (state == "failed")
    assert outcome.figures
    assert all(figure.unit for figure in outcome.figures)
    own = next(each for each in found.acceptance.checks if each.name == name)
    assert own.recordings
    assert set(own.recordings) <= set(found.bench.recordings)


def test_no_two_checks_have_the_same_place_or_title() -> None:
    kinds = [kind for _, kind in in_order()]

    assert len({kind.place for kind in kinds}) == len(kinds)
    assert len({kind.title for kind in kinds}) == len(kinds)


def test_a_check_needs_only_checks_that_come_before_it() -> None:
    names = [name for name, _ in in_order()]

    for place, (_, kind) in enumerate(in_order()):
        assert set(kind.needs) <= set(names[:place])


def test_those_that_prove_a_stop_come_before_all_that_drive_and_end_everything_where_they_fail() -> None:
    names = [name for name, _ in in_order()]
    drives = [name for name in names if CHECKS[name].place >= 30]

    assert [name for name in names if CHECKS[name].halts] == ["rest", "stop", "watchdog"]
    assert drives[:2] == ["stop", "watchdog"]
    assert all({"stop", "watchdog"} <= set(CHECKS[name].needs) for name in drives[2:])


def test_a_sound_bench_has_every_check_verified_that_needs_no_hand_and_no_real_time() -> None:
    states = {each.name: each.outcome.state for each in sound().acceptance.checks}

    assert {name for name, state in states.items() if state != "verified"} == {"timing", "turns"}
    assert set(states.values()) <= set(STATES)
