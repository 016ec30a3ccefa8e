"""A conversation with a board: which answer belongs to what was said, and what is missing of what the board says."""

from __future__ import annotations

from collections import deque

import pytest

from servobench.core.errors import DeviceError
from servobench.rig.wire.conversation import PATIENCE, TURN, Conversation
from servobench.rig.wire.frames import encode
from servobench.rig.wire.messages import protocol


def message(name: str, sequence: int, **values: int) -> bytes:
    """A frame of a board, with zeros in what isn't given."""
    kind = protocol().message(name)
    zeros = {field.name: (0,) * field.count if field.count > 1 else 0 for field in kind.fields}
    return encode(kind.pack(sequence, **zeros | values))


class Port:
    """A port at which lies what is to be read, a piece a turn."""

    def __init__(self, *pieces: bytes) -> None:
        self.pieces = deque(pieces)
        self.turns = 0

    def read(self) -> bytes:
        self.turns += 1
        return self.pieces.popleft() if self.pieces else b""

    def write(self, data: bytes) -> None: ...

    def close(self) -> None: ...


@pytest.mark.parametrize("gap", [0, 1, 127, 128, 254])
def test_frames_that_are_missing_are_counted_by_their_numbers(gap: int) -> None:
    port = Port(message("status", 250), message("status", (251 + gap) & 0xFF))
    talk = Conversation(port, "port")

    for _ in range(2):
        list(talk.hear())

    assert talk.lost == gap


def test_an_answer_is_that_to_the_same_message_and_to_the_same_one() -> None:
    """A STATUS by itself, one to another message, one to the same message said earlier: none of them answers."""
    hello, stop = (protocol().message(name).code for name in ("hello", "stop"))
    port = Port(
        message("status", 0),
        message("status", 1, command=stop, ack=1),
        message("status", 2, command=hello, ack=0),
        message("status", 3, command=hello, ack=1, refusal=0),
    )
    talk = Conversation(port, "port")
    talk.say("hello", schema=0)

    assert talk.ask("hello", schema=0)["sequence"] == 3


def test_who_doesn_t_answer_is_given_up_after_so_many_turns() -> None:
    port = Port()

    with pytest.raises(DeviceError, match="port didn't answer stop"):
        Conversation(port, "port").ask("stop")
    assert (
        PATIENCE <= port.turns * TURN < PATIENCE + 1.5 * TURN
    )  # turns of a twentieth add up to a little less than they are
