"""A Quanser QUBE-Servo at a USB port, or one of Quanser's simulator, through Quanser's own software.

Verified on simulated hardware only: `servobench.compat.quanser` stood in for board and software.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from types import TracebackType
from typing import Any, ClassVar, Literal, Self

import numpy as np

from servobench.core.channels import Channel, DeviceInfo, Sample
from servobench.core.errors import DeviceError, UsageError
from servobench.core.settings import PositiveTime, PositiveVoltage, Settings, Time
from servobench.recordings.recording import Stopped
from servobench.rig.devices.base import DEVICES, RunEnded, finite_voltage
from servobench.rig.motor.encoder import CurrentSensor

COUNTS_PER_REV, COUNTER_BITS, LARGEST_VOLTAGE = 2048, 24, 15.0
GREEN, RED, BLUE = (0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
_LIGHTS, _TACHOMETER = (11000, 11001, 11002), 14000
_OVERWRITE, _SYNCHRONIZED = 1, 4  # what a task does with samples that nobody has fetched in time
_ROUTE = (
    "Quanser's Python package isn't installed here: its installers for Windows are at github.com/quanser/quanser_sdk_win64, "
    "and the way to install it with apt on Linux at github.com/quanser/quanser_sdk_linux"
)


@dataclass(frozen=True, kw_only=True)
class _Model:
    """A generation: its type for Quanser's software, whether it has sensors beside the encoders, and its simulator's port."""

    card_type: str
    senses: bool = True
    port: int | None = None


_MODELS = {
    "qube_servo": _Model(card_type="qube_servo_usb", senses=False),
    "qube_servo_2": _Model(card_type="qube_servo2_usb", port=18920),
    "qube_servo_3": _Model(card_type="qube_servo3_usb", port=18922),
}


class QuanserSettings(Settings):
    """The board, and its use."""

    board: Literal["qube_servo", "qube_servo_2", "qube_servo_3"] = "qube_servo_2"
    """Its generation."""
    identifier: str = "0"
    """The number of the board among those of its type: 0 is the first."""
    simulator: bool = False
    """Whether it is the one of Quanser's simulator on this computer, with the disc."""
    options: str | None = None
    """Board options as Quanser's software takes them, such as deadband_compensation=0.3; none are set by default."""
    voltage_limit: PositiveVoltage = 10.0
    """Largest voltage that is put out; Quanser recommends 10 V and permits 15 V [V]."""
    buffer: PositiveTime = 0.5
    """For how long samples are kept that weren't fetched in time [s]."""
    overflow: Literal["error", "count"] = "error"
    """Whether samples that are lost end the run, or are counted and left out."""
    watchdog: Time = 0.2
    """The board's watchdog, where it has one: without a voltage for that long the motor is let go; 0 leaves it off [s]."""


@DEVICES.member("quanser")
class Quanser:
    """A QUBE-Servo 1, 2 or 3: its hardware clock times the samples, and each is fetched by one call that waits for it.

    The amplifier is on from `start` to `stop` only, after which voltages do nothing until the next `start`. The light is green
    while it is on, red otherwise, blue where the watchdog has expired. Raises `DeviceError` where the software, the board or a
    sample is missing, and `UsageError` for settings that no board has.
    """

    Settings: ClassVar[type[QuanserSettings]] = QuanserSettings

    def __init__(self, settings: QuanserSettings | None = None) -> None:
        self.settings = settings or QuanserSettings()
        self._model = _MODELS[self.settings.board]
        if self.settings.voltage_limit > LARGEST_VOLTAGE:
            raise UsageError(
                f"quanser: voltage_limit is {self.settings.voltage_limit:g} V; the amplifier permits "
                f"{LARGEST_VOLTAGE:g} V at most"
            )
        if self.settings.watchdog < 0:
            raise UsageError(f"quanser: watchdog is {self.settings.watchdog:g} s; expected 0 or more")
        if self.settings.simulator and self._model.port is None:
            raise UsageError(f"quanser: there is no simulator of a {self.settings.board}")
        self.watchdog: Literal["unknown", "unsupported", "running", "off"] = "unknown"
        self._card: Any = None
        self._error: type[Exception] = OSError
        self._task: Any = None
        self._driven = False
        self._read, self._lost, self._sample_time = 0, 0, math.nan
        self._currents, self._counts = np.zeros(1), np.zeros(1, np.int32)
        self._faults, self._speeds = np.zeros(3, np.int8), np.zeros(1)

    @property
    def info(self) -> DeviceInfo:
        """Its channels, and that the board keeps the time; the watchdog is "unknown" until a voltage was written."""
        limit = self.settings.voltage_limit
        channels = [
            Channel(name="voltage", unit="V", minimum=-limit, maximum=limit),
            Channel(
                name="counts",
                unit="counts",
                resolution=1.0,
                counter_bits=COUNTER_BITS,
                counts_per_rev=COUNTS_PER_REV,
            ),
        ]
        if self._model.senses:
            sensor = CurrentSensor()
            channels += [
                Channel(
                    name="current",
                    unit="A",
                    minimum=-sensor.range,
                    maximum=sensor.range,
                    resolution=sensor.resolution,
                ),
                Channel(name="tachometer", unit="rad/s", resolution=2 * math.pi / COUNTS_PER_REV),
            ]
        values = self.settings.model_dump(exclude_defaults=True)
        settings = (("board", self.settings.board), *((n, str(v)) for n, v in values.items() if n != "board"))
        return DeviceInfo(
            name="quanser",
            channels=tuple(channels),
            timing="device",
            settings=(*settings, ("watchdog_state", self.watchdog)),
        )

    def __enter__(self) -> Self:
        """Open the board, at zero volts with the amplifier off."""
        try:
            from quanser.hardware import HIL, MAX_STRING_LENGTH, HILError
        except (ImportError, OSError) as error:  # the package is missing, or the library that it loads
            raise DeviceError(f"quanser: {_ROUTE} ({error})") from error
        self._error = HILError
        address = self.settings.identifier
        if self.settings.simulator:
            address += f"@tcpip://localhost:{self._model.port}?nagle='off'"
        self._card = self._call("open the board", lambda: HIL(self._model.card_type, address))
        try:
            if self.settings.options:
                self._call(
                    "set its options",
                    lambda: self._card.set_card_specific_options(self.settings.options, MAX_STRING_LENGTH),
                )
            self._put(0.0)
            self._switch(on=False)
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop the motor and close the board."""
        self.stop()
        card, self._card = self._card, None
        if card is not None:
            self._end_task(card)
            with suppress(Exception):  # a board that is gone can't be closed, and there is nothing left to do
                card.close()

    def start(self, sample_time: float, seed: int | None) -> None:
        """Start the board's clock with that sample time [s], counts at 0, amplifier on; raises `UsageError` for no such time."""
        self._needs_board()
        if not (math.isfinite(sample_time) and sample_time > 0):
            raise UsageError(f"quanser: the sample time is {sample_time!r}; expected a finite time above 0 s")
        self._end_task(self._card)
        self._put(0.0)
        one = np.zeros(1, np.uint32)
        self._call("reset the counter", lambda: self._card.set_encoder_counts(one, 1, np.zeros(1, np.int32)))
        self._switch(on=True)
        self.light(*GREEN)
        self._read = self._lost = 0
        self._sample_time = sample_time
        self._call("start its clock", lambda: self._start_task(sample_time))

    def _start_task(self, sample_time: float) -> None:
        """Let the board sample all that it has, at its hardware clock."""
        one, none = np.zeros(1, np.uint32), (None, 0)
        senses = self._model.senses
        size = max(math.ceil(self.settings.buffer / sample_time), 2)
        self._task = self._card.task_create_reader(
            size,
            *((one, 1) if senses else none),
            one,
            1,
            *((np.arange(3, dtype=np.uint32), 3) if senses else none),
            *((np.array([_TACHOMETER], np.uint32), 1) if senses else none),
        )
        if self.settings.simulator:
            self._card.task_set_buffer_overflow_mode(self._task, _SYNCHRONIZED)
        elif self.settings.overflow == "count":
            self._card.task_set_buffer_overflow_mode(self._task, _OVERWRITE)
        self._card.task_start(self._task, 0, 1.0 / sample_time, type(self._card).INFINITE)

    def read(self) -> Sample:
        """Wait for the next sample and return it; raises `RunEnded` where the board says that amplifier or motor failed."""
        self._needs_board()
        if self._task is None:
            raise UsageError("quanser: no run was started; call start() first")
        senses = self._model.senses
        fetched = self._call(
            "fetch a sample",
            lambda: self._card.task_read(
                self._task,
                1,
                self._currents if senses else None,
                self._counts,
                self._faults if senses else None,
                self._speeds if senses else None,
            ),
        )
        if fetched != 1:
            raise DeviceError("quanser: the board's clock stopped; no sample came")
        if self.settings.overflow == "count":
            self._lost = self._call(
                "count lost samples", lambda: self._card.task_get_buffer_overflows(self._task)
            )
        index = self._read + self._lost
        self._read += 1
        sample = Sample(
            index=index,
            time=index * self._sample_time,
            counts=int(self._counts[0]),
            tachometer=float(self._speeds[0]) * 2 * math.pi / COUNTS_PER_REV if senses else None,
            current=float(self._currents[0]) if senses else None,
        )
        self._check_faults(sample)
        return sample

    def _check_faults(self, sample: Sample) -> None:
        """End the run where the board reports that its amplifier or motor failed; it warns of a stall before, which isn't one."""
        failures = {
            0: "the amplifier reports a fault; it may be too hot: let it cool down",
            2: "the board has cut the motor off after a stall of three seconds: turn the shaft by hand, with the board off",
        }
        for channel, sentence in failures.items():
            if self._faults[channel]:
                self.stop()
                raise RunEnded(Stopped(reason="fault", sentence=f"quanser: {sentence}"), sample)

    def write(self, voltage: float) -> float:
        """Put a voltage [V] out until the next one, and return it as limited; 0 V where `stop` came before."""
        self._needs_board()
        requested = finite_voltage("quanser", voltage)
        if not self._driven:
            return 0.0
        limit = self.settings.voltage_limit
        put = max(-limit, min(limit, requested))
        self._put(put)
        self._feed_watchdog()
        return put

    def _feed_watchdog(self) -> None:
        """Reload the watchdog; the first voltage of a run starts it, where the board has one."""
        if not self.settings.watchdog:
            self.watchdog = "off"
        elif self.watchdog == "running":
            if not self._call("reload the watchdog", lambda: self._card.watchdog_reload()):
                raise DeviceError(
                    f"quanser: the board's watchdog has let the motor go, as no voltage came for {self.settings.watchdog:g} s"
                )
        elif self.watchdog == "unknown":
            self._start_watchdog()

    def _start_watchdog(self) -> None:
        """Try the watchdog: nobody has said in public which boards have one."""
        card, one = self._card, np.zeros(1, np.uint32)
        lights = np.array(_LIGHTS, np.uint32)
        configurations: tuple[Callable[[], object], ...] = (
            lambda: card.watchdog_set_analog_expiration_state(one, 1, np.zeros(1)),
            lambda: card.watchdog_set_digital_expiration_state(one, 1, np.zeros(1, np.int32)),
            lambda: card.watchdog_set_other_expiration_state(lights, 3, np.array(BLUE)),
        )
        for configure in configurations:
            with suppress(self._error):  # most boards have fixed states, and a watchdog all the same
                configure()
        try:
            card.watchdog_start(self.settings.watchdog)
        except self._error:
            self.watchdog = "unsupported"
        else:
            self.watchdog = "running"

    def stop(self) -> None:
        """Put zero volts out, turn the amplifier off and the light red; each is tried, whatever the others do."""
        self._driven = False
        card = self._card
        if card is None:
            return
        one = np.zeros(1, np.uint32)
        acts: tuple[Callable[[], object], ...] = (
            lambda: card.write_analog(one, 1, np.zeros(1)),
            lambda: card.write_digital(one, 1, np.zeros(1, np.int8)),
            lambda: card.write_other(np.array(_LIGHTS, np.uint32), 3, np.array(RED)),
        )
        zeroed, switched, _ = [_succeeds(act) for act in acts]
        # Where neither came through, the watchdog is what is left: it is no longer fed, and expires.
        if self.watchdog == "running" and (zeroed or switched):
            _succeeds(card.watchdog_stop)
            self.watchdog = "unknown"

    def light(self, red: float, green: float, blue: float) -> None:
        """Light the lamp, each colour from 0 to 1."""
        self._needs_board()
        lights = np.array(_LIGHTS, np.uint32)
        self._call("light the lamp", lambda: self._card.write_other(lights, 3, np.array([red, green, blue])))

    def _put(self, voltage: float) -> None:
        one = np.zeros(1, np.uint32)
        self._call("put a voltage out", lambda: self._card.write_analog(one, 1, np.array([voltage])))

    def _switch(self, *, on: bool) -> None:
        """Turn the amplifier on or off."""
        one = np.zeros(1, np.uint32)
        self._call(
            f"turn the amplifier {'on' if on else 'off'}",
            lambda: self._card.write_digital(one, 1, np.array([on], np.int8)),
        )
        self._driven = on

    def _end_task(self, card: Any) -> None:
        task, self._task = self._task, None
        if task is not None:
            with suppress(Exception):  # it ends with the board, too
                card.task_stop(task)
                card.task_delete(task)

    def _call(self, what: str, act: Callable[[], Any]) -> Any:
        """Call the board; its error becomes a `DeviceError` with its words."""
        try:
            return act()
        except self._error as error:
            tell = getattr(error, "get_error_message", None)
            message = tell() if tell else str(error)
            raise DeviceError(
                f"quanser: {self.settings.board} {self.settings.identifier!r} couldn't {what}: {message}"
            ) from error

    def _needs_board(self) -> None:
        if self._card is None:
            raise DeviceError("quanser: the board isn't open; use it inside a with statement")


def _succeeds(act: Callable[[], object]) -> bool:
    """Do something that may fail, and return whether it didn't; a stop never raises.

    A board that is gone may raise anything. The guard sees by the shaft whether it stands.
    """
    try:
        act()
    except Exception:
        return False
    return True
