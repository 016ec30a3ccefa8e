"""The firmware's files that touch no register, compiled for this computer: what takes millions of tries."""

import ctypes as c

import pytest

from servobench.rig.wire.frames import crc16
from tests.rig.simavr import build
from tests.rig.simavr.board import STATES

EVENTS = ("initialised", "claim", "enable", "stop", "release", "fault", "clear")
NONE = 0xFF


@pytest.fixture(scope="module")
def pure() -> c.CDLL:
    return c.CDLL(str(build.pure()))


def damaged(pure: c.CDLL, frames: int, seed: int) -> tuple[int, int, int]:
    """How many damaged frames came through as another duty, how many at all, and how many only the duty's inverse gave away."""
    accepted, caught = c.c_uint32(), c.c_uint32()
    pure.pure_damage.restype = c.c_uint32
    return pure.pure_damage(frames, seed, c.byref(accepted), c.byref(caught)), accepted.value, caught.value


def test_no_damaged_frame_is_taken_for_another_duty(pure: c.CDLL) -> None:
    wrong, accepted, _ = damaged(pure, 100_000, 1)

    assert wrong == 0
    # Two flips of one bit, or a doubled zero at the end, leave a frame as it was.
    assert accepted < 8_000


@pytest.mark.long
def test_no_damaged_frame_of_a_million_is_taken_for_another_duty(pure: c.CDLL) -> None:
    assert damaged(pure, 1_000_000, 2)[0] == 0


def test_a_duty_that_the_checksum_lets_pass_is_given_away_by_its_inverse(pure: c.CDLL) -> None:
    wrong, _, caught = damaged(pure, 10_000_000, 3)

    assert wrong == 0
    assert caught > 0


def test_the_checksum_is_that_of_the_host(pure: c.CDLL) -> None:
    pure.crc16.restype = c.c_uint16
    for data in (b"", b"123456789", bytes(range(76))):
        assert pure.crc16(data, len(data)) == crc16(data)


def test_these_are_all_transitions_of_the_states(pure: c.CDLL) -> None:
    names = {code: name for name, code in STATES.items()}
    found = {
        (names[state], event): names[after]
        for state in names
        for number, event in enumerate(EVENTS)
        if (after := pure.pure_next_state(state, number) & 0xFF) != NONE
    }

    moved = {key: after for key, after in found.items() if key[1] not in ("fault", "stop")}
    assert moved == {
        ("not_ready", "initialised"): "switch_on_disabled",
        ("switch_on_disabled", "claim"): "ready",
        ("ready", "claim"): "ready",
        ("ready", "enable"): "operation_enabled",
        ("ready", "release"): "switch_on_disabled",
        ("fault", "clear"): "switch_on_disabled",
    }
    assert {state: found[state, "fault"] for state in STATES} == dict.fromkeys(STATES, "fault")
    assert {state: after for (state, event), after in found.items() if event == "stop"} == {
        "switch_on_disabled": "switch_on_disabled",
        "ready": "ready",
        "operation_enabled": "ready",
        "fault": "fault",
    }
