"""A device for tests: a shaft that turns by one count for each volt and tick, notes what is done to it, and fails on request."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from servobench.core.channels import Channel, DeviceInfo, Sample, Timing
from servobench.rig.experiment import Experiment
from servobench.systems.signals.constant import Constant


class Shaft:
    def __init__(
        self,
        timing: Timing = "virtual",
        on_read: Callable[[int], None] = lambda index: None,
        on_write: Callable[[int], None] = lambda index: None,
        tachometer: bool = False,
    ) -> None:
        self.timing = timing
        self.on_read = on_read
        self.on_write = on_write
        self.tachometer = tachometer
        self.events: list[str] = []
        self.writes = 0
        self.voltage = 0.0
        self.index = -1
        self.position = 0.0

    @property
    def info(self) -> DeviceInfo:
        sensors = (Channel(name="tachometer", unit="rad/s"),) if self.tachometer else ()
        voltage = Channel(name="voltage", unit="V", minimum=-5.0, maximum=5.0)
        return DeviceInfo(
            name="shaft",
            channels=(voltage, Channel(name="counts", unit="counts"), *sensors),
            timing=self.timing,
        )

    def start(self, sample_time: float, seed: int | None) -> None:
        self.events.append("start")
        self.sample_time = sample_time
        self.voltage, self.index, self.position = 0.0, -1, 0.0

    def read(self) -> Sample:
        self.index += 1
        self.on_read(self.index)
        self.position += self.voltage
        return Sample(
            index=self.index,
            time=self.index * self.sample_time,
            counts=int(self.position),
            tachometer=0.5 * self.index if self.tachometer else None,
        )

    def write(self, voltage: float) -> float:
        self.on_write(self.index)
        self.writes += 1
        self.voltage = min(max(voltage, -5.0), 5.0)
        return self.voltage

    def stop(self) -> None:
        self.events.append("stop")
        self.voltage = 0.0


def experiment(**changes: Any) -> Experiment:
    """Return 1 s of 2 V, at 100 Hz."""
    return Experiment(**{"signal": Constant(value=2.0), "duration": 1.0, "sample_time": 0.01, **changes})


def odd(**changes: Any) -> Any:
    """Return an experiment that no file can describe: with a signal or a controller that exists in a test only."""
    plain = experiment()
    names = (
        "name",
        "signal",
        "duration",
        "sample_time",
        "controller",
        "limits",
        "seed",
        "samples",
        "when_late",
        "to_toml",
    )
    return SimpleNamespace(**{**{name: getattr(plain, name) for name in names}, **changes})


class Controller:
    """Commands what a function of the tick's number gives."""

    reference_unit = "V"

    def __init__(self, command: Callable[[int], Any]) -> None:
        self.command = command

    def start(self, sample_time: float, info: DeviceInfo) -> int:
        return 0

    def step(self, state: int, reference: float, sample: Sample) -> tuple[int, Any]:
        return state + 1, self.command(state)

    def take_over(
        self, sample_time: float, info: DeviceInfo, reference: float, sample: Sample, voltage: float
    ) -> int:
        return 0
