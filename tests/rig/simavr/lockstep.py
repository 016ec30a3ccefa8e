"""The device `rig` in lock-step with the simulated rig: its port is the firmware's own, and device time passes while it reads."""

from __future__ import annotations

from servobench.rig.devices.rig import Rig, RigSettings
from servobench.rig.wire.conversation import TURN
from tests.rig.simavr.board import Board, Motor


class LockStepPort:
    """A port whose other end is the firmware in simavr; from power-on where it is opened."""

    def __init__(self, firmware: str = "rig-500000", around: Motor | None = None) -> None:
        self.board = Board(firmware, around)
        self.unplugged = False

    def read(self) -> bytes:
        self._check()
        self.board.run_to_frame(ms=1000 * TURN)
        return self.board.read()

    def write(self, data: bytes) -> None:
        self._check()
        self.board.write(data)

    def close(self) -> None:
        pass

    def _check(self) -> None:
        if self.unplugged:
            raise OSError(5, "Input/output error")


class SimulatedRig(Rig):
    """The device, with the port that it opened last at hand."""

    def __init__(self, settings: RigSettings, around: Motor | None = None, firmware: str = "rig-500000") -> None:
        super().__init__(settings, open_port=self._open)
        self._around = around
        self._firmware = firmware

    def _open(self, name: str, baud: int) -> LockStepPort:
        self.port = LockStepPort(self._firmware, self._around)
        return self.port

    @property
    def board(self) -> Board:
        return self.port.board


def simulated(around: Motor | None = None, firmware: str = "rig-500000", **settings: object) -> SimulatedRig:
    """Return the device at a simulated rig, whose settings agree with the motor around it."""
    return SimulatedRig(RigSettings.model_validate({"port": "simavr", **settings}), around, firmware)
