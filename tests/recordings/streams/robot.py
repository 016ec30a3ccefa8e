"""A simulated robot that publishes over a real NetworkTables server, by the time of the simulation."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import ntcore
import numpy as np

from servobench.core.channels import Array
from servobench.recordings.streams.networktables import NetworkTables

PATIENCE = 60.0  # s of a busy machine


@dataclass
class Robot:
    """A server at `port` and the publishers of voltage and position."""

    port: int
    server: Any
    voltage: Any
    position: Any

    def await_listener(self, stream: NetworkTables) -> None:
        """Publish a first row until the stream gives it: it has subscribed to both topics then."""
        until = time.monotonic() + PATIENCE
        self.publish(np.array([-0.02]), np.zeros(1), np.zeros(1))
        while not len(_rows(stream)):
            assert time.monotonic() < until, "nobody subscribed"

    def publish(self, t: Array, u: Array, y: Array) -> None:
        """Publish rows at their times [s]: first the position, then the voltage, as a robot's loop does."""
        for time_, voltage, position in zip(t, u, y, strict=True):
            stamp = 1_000_000 + round(1e6 * float(time_))
            self.position.set(float(position), stamp)
            self.voltage.set(float(voltage), stamp + 50)
        self.server.flush()


def _rows(stream: NetworkTables) -> Array:
    rows = stream.read(0.1)
    assert rows is not None
    return rows.values


@contextmanager
def robot() -> Iterator[Robot]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    server = ntcore.NetworkTableInstance.create()
    server.startServer("", "127.0.0.1", 0, port)
    options = ntcore.PubSubOptions(sendAll=True, keepDuplicates=True)
    topics = [server.getDoubleTopic(f"/drive/{name}").publish(options) for name in ("voltage", "position")]
    try:
        yield Robot(port, server, *topics)
    finally:
        for each in topics:
            each.close()
        server.stopServer()
        ntcore.NetworkTableInstance.destroy(server)
