"""Every call of the interface does something or says in an error of its own why not; on a closed board it says that."""

import inspect
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

from servobench.compat.quanser import install
from servobench.compat.quanser.errors import Code, HILError
from servobench.compat.quanser.hil import HIL

WITHOUT_A_BOARD = {"open", "close", "close_all", "get_version", "is_valid"}
CALLS = sorted(
    name
    for name, call in inspect.getmembers(HIL, callable)
    if not name.startswith("_") and name not in WITHOUT_A_BOARD
)
KINDS = {
    "analog": np.float64,
    "encoder": np.int32,
    "digital": np.int8,
    "other": np.float64,
    "pwm": np.float64,
}
PLAIN: dict[str, Any] = {
    "task": None,
    "timeout": 0.1,
    "samples_in_buffer": 4,
    "buffer_size": 64,
    "size": 0,
    "options": "",
    "property_code": 3,
    "mode": 1,
}


def argument(call: str, name: str) -> Any:
    """One channel, or one value, of the kind that the call and its argument are named after."""
    if name in PLAIN:
        return PLAIN[name]
    if name.startswith("num_"):
        return 1
    kind = next((each for text in (name, call) for each in KINDS if each in text), "encoder")
    if not name.endswith("channels"):
        return np.ones(1, KINDS[kind])
    is_output = "output" in name or ("input" not in name and "write" in call)
    return np.array([0 if kind != "other" else 11000 if is_output else 14000], np.uint32)


@pytest.fixture
def card() -> Iterator[HIL]:
    with install(quiet=True):
        yield HIL("qube_servo2_usb", "0")


@pytest.mark.parametrize("call", CALLS)
def test_a_call_returns_or_says_why_not(card: HIL, call: str) -> None:
    bound = getattr(card, call)
    arguments = [argument(call, name) for name in inspect.signature(bound).parameters]
    with suppress(HILError):  # anything else is a fault of the stand-in
        bound(*arguments)

    card.close()
    # A task is looked for before the board that it was one of.
    expected = {-Code.INVALID_CARD, -Code.INVALID_TASK, -Code.TASK_IS_NULL}
    with pytest.raises(HILError, check=lambda error: error.error_code in expected):
        bound(*arguments)
