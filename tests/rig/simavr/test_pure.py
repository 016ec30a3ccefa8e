"""The firmware's files that touch no register, compiled for this computer: what takes millions of tries."""

import ctypes as c

import pytest

from servobench.rig.wire.frames import check16, crc16
from tests.rig.simavr import build
from tests.rig.simavr.board import STATES

EVENTS = ("initialised", "claim", "enable", "stop", "release", "fault", "clear")
NONE = 0xFF


@pytest.fixture(scope="module")
def pure() -> c.CDLL:
    return c.CDLL(str(build.pure()))


KINDS = pytest.mark.parametrize("table", [False, True], ids=["duty", "table"])


def damaged(pure: c.CDLL, table: bool, frames: int, seed: int) -> tuple[int, int, int]:
    """The number of damaged frames accepted as another one, of all, and of those that only the second checksum revealed."""
    accepted, caught = c.c_uint32(), c.c_uint32()
    pure.pure_damage.restype = c.c_uint32
    wrong = pure.pure_damage(frames, seed, int(table), c.byref(accepted), c.byref(caught))
    return wrong, accepted.value, caught.value


@KINDS
def test_no_damaged_frame_is_taken_for_another_one(pure: c.CDLL, table: bool) -> None:
    wrong, accepted, _ = damaged(pure, table, 100_000, 1)

    assert wrong == 0
    # Two flips of one bit, or a doubled zero at the end, leave a frame as it was.
    assert accepted < 8_000


@pytest.mark.long
@KINDS
def test_no_damaged_frame_of_a_hundred_million_is_taken_for_another_one(pure: c.CDLL, table: bool) -> None:
    wrong, _, caught = damaged(pure, table, 100_000_000, 2)

    assert wrong == 0
    assert caught > 50


@KINDS
def test_a_frame_that_its_checksum_lets_pass_is_given_away_by_the_second_one(
    pure: c.CDLL, table: bool
) -> None:
    wrong, _, caught = damaged(pure, table, 10_000_000, 3)

    assert wrong == 0
    assert caught > 0


def test_the_checksums_are_those_of_the_host(pure: c.CDLL) -> None:
    pure.crc16.restype = pure.check16.restype = c.c_uint16
    for data in (b"", b"123456789", bytes(range(76))):
        assert pure.crc16(data, len(data)) == crc16(data)
        assert pure.check16(data, len(data)) == check16(data)


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
