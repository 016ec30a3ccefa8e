"""A robot's NetworkTables 4, read with pyntcore: voltage, position and velocity as the robot publishes them."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.recordings.streams.base import STREAMS, Rows

if TYPE_CHECKING:
    from ntcore import NetworkTableInstance

_KEPT = 10_000  # values of a topic that wait to be read
_AGAIN = 0.02  # s between two looks
_PORT = 5810
_MICROSECOND = 1e-6
_PASS = 0.002  # s in which a loop publishes all of its topics
_HELD = 0.2  # s of this computer; several times what robots' networks take to bring values of one pass


@STREAMS.member("networktables")
class NetworkTables:
    """Topics of a robot: `networktables:HOST[:PORT]/TOPIC,...`, such as `networktables:10.12.34.2/drive/voltage,/drive/position`.

    The columns are `time` in s, by the server's clock, and the topics by their last part. There is a row at each time at which
    the last topic named, the position, comes; the others have their values of the same pass of the robot's loop, which ends 2 ms
    later, or the latest before it. NetworkTables leave out a value that is the same as before, unless the robot publishes with
    `keepDuplicates`. This subscribes and never publishes.
    Raises `UsageError` for a text without a host and two topics.
    """

    def __init__(
        self,
        rest: str,
        *,
        sleep: Callable[[float], None] = time.sleep,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        place, slash, topics = rest.partition("/")
        host, colon, port = place.partition(":")
        self._topics = [
            f"/{each.strip().lstrip('/')}" for each in f"{slash}{topics}".split(",") if each.strip(" /")
        ]
        names = [each.rpartition("/")[2] for each in self._topics]
        if not host or len(names) < 2 or len(set(names)) < len(names) or (colon and not port.isdecimal()):
            raise UsageError(
                f"networktables:{rest}: expected a host and topics with different last names, the position last, such as "
                "networktables:10.12.34.2/drive/voltage,/drive/position"
            )
        self._host, self._port = host, int(port or _PORT)
        self.name = f"NetworkTables of {host}"
        self._names = ("time", *names)
        self._latest = np.full(len(names), np.nan)
        self._open_row: list[float] = []
        self._opened = 0.0
        self._pending: list[tuple[float, int, float, float]] = []  # time [s], topic, value, when it came [s]
        self._newest = [-np.inf] * len(names)
        self._sleep = sleep
        self._now = now
        self._instance: NetworkTableInstance | None = None
        self._subscribers: list[Any] = []

    def __enter__(self) -> Self:
        """Subscribe to the topics."""
        try:
            import ntcore
        except ImportError:
            raise UsageError("NetworkTables need pyntcore: python -m pip install 'servobench[frc]'") from None
        self._instance = ntcore.NetworkTableInstance.create()
        options = ntcore.PubSubOptions(periodic=_AGAIN, sendAll=True, pollStorage=_KEPT, keepDuplicates=True)
        self._subscribers = [
            self._instance.getDoubleTopic(topic).subscribe(np.nan, options) for topic in self._topics
        ]
        self._instance.setServer(self._host, self._port)
        self._instance.startClient4("servobench watch")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the server."""
        if self._instance is not None:
            import ntcore

            for each in self._subscribers:
                each.close()
            self._instance.stopClient()
            ntcore.NetworkTableInstance.destroy(self._instance)
            self._instance = None

    def read(self, patience: float) -> Rows | None:
        """Return the rows that have come; never None, as a robot that restarts is found again."""
        waited = 0.0
        while not len(rows := self._rows()) and waited < patience:
            self._sleep(_AGAIN)
            waited += _AGAIN
        return Rows(names=self._names, values=rows)

    def _rows(self) -> Array:
        """The rows of the passes of which all is here.

        Each topic has a queue of its own, and the others fill up while one is read: after a pause of the network by seconds.
        """
        now = self._now()
        for at, each in enumerate(self._subscribers):
            for value in each.readQueue():
                self._newest[at] = value.serverTime * _MICROSECOND
                self._pending.append((self._newest[at], at, value.value, now))
        self._pending.sort()
        until = self._complete_until(now)
        ready = [each for each in self._pending if each[0] <= until]
        self._pending = self._pending[len(ready) :]
        rows: list[list[float]] = []
        for time_, at, value, came in ready:
            if self._open_row and time_ > self._open_row[0] + _PASS:
                self._close_row(rows)
            if at == len(self._latest) - 1:
                self._close_row(rows)
                self._open_row, self._opened = [time_], came
            self._latest[at] = value
        if self._open_row and until >= self._open_row[0] + _PASS:
            self._close_row(rows)
        return np.array(rows, dtype=np.float64).reshape(len(rows), len(self._names))

    def _complete_until(self, now: float) -> float:
        """The server's time [s] up to which all is here: each topic has come as far, or what came has waited for `_HELD`."""
        waiting = [(time_, came) for time_, _, _, came in self._pending]
        waiting += [(self._open_row[0], self._opened)] if self._open_row else []
        return max([min(self._newest), *(time_ + _PASS for time_, came in waiting if now - came >= _HELD)])

    def _close_row(self, rows: list[list[float]]) -> None:
        """Add the row under way to the others, unless a topic never came."""
        if self._open_row and np.isfinite(self._latest).all():
            rows.append([*self._open_row, *self._latest])
        self._open_row = []
