"""The loop's own process: what a request to end does in it."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator

import pytest

from servobench.rig.loop import child
from servobench.rig.loop.requests import requests_here

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    """Put the handlers of this process back in the end."""
    before = {each: signal.getsignal(each) for each in requests_here()}
    yield
    for request, handler in before.items():
        signal.signal(request, handler)


def test_a_request_that_is_repeated_at_once_does_not_interrupt_the_stop_that_the_first_one_began() -> None:
    time = 100.0
    child._terminate_like_ctrl_c(lambda: time)
    with pytest.raises(KeyboardInterrupt, match="SIGTERM"):
        signal.raise_signal(signal.SIGTERM)

    time += 0.9 * child.SAME_REQUEST
    signal.raise_signal(signal.SIGTERM)
    signal.raise_signal(signal.SIGHUP)

    time += 0.2 * child.SAME_REQUEST
    with pytest.raises(KeyboardInterrupt, match="SIGHUP"):  # it breaks a stop that hangs
        signal.raise_signal(signal.SIGHUP)
