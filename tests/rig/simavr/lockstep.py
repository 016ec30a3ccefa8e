"""The device `rig` in lock-step with the simulated rig: its port is the firmware's own, and device time passes while it reads."""

from __future__ import annotations

from servobench.recordings.recording import Recording
from servobench.rig.devices.guarded import Guarded
from servobench.rig.devices.rig import Rig, RigSettings
from servobench.rig.experiment import Experiment
from servobench.rig.loop.run import Watch, run
from servobench.rig.wire.conversation import TURN
from tests.rig.simavr.board import CYCLES, Board, Motor


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


class Bench:
    """Simulated rigs, one for each time that the port is opened; `board` is the one of the last time."""

    def __init__(self, around: Motor | None = None, firmware: str = "rig-500000") -> None:
        self._around = around
        self._firmware = firmware

    def open_port(self, name: str, baud: int) -> LockStepPort:
        self.port = LockStepPort(self._firmware, self._around)
        return self.port

    @property
    def board(self) -> Board:
        return self.port.board

    def rig(self, **settings: object) -> Rig:
        """Return the device at this bench; its settings agree with the motor unless others are given."""
        return Rig(RigSettings.model_validate({"port": "simavr", **settings}), open_port=self.open_port)

    def now(self) -> float:
        """The time by the board's own clock [s]."""
        return self.board.look().cycle / CYCLES

    def run(self, experiment: Experiment, rig: Rig, watch: Watch | None = None) -> Recording:
        """Run an experiment with a guard that goes by device time: the computer's is another one."""
        return run(experiment, Guarded(rig, experiment.limits, now=self.now), watch=watch)
