"""The open rig: a board with a bridge and an encoder at a serial port, with the firmware of this project's folder `firmware`."""

from __future__ import annotations

import math
import secrets
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from time import monotonic
from types import TracebackType
from typing import Annotated, Any, ClassVar, NamedTuple, Self

from pydantic import Field

from servobench.core.channels import Array, Channel, DeviceInfo, Sample
from servobench.core.errors import DeviceError, UsageError
from servobench.core.finding import Finding, warning
from servobench.core.parameter_names import plain_words
from servobench.core.settings import CountsPerRev, PositiveTime, PositiveVoltage, Resistance, Settings
from servobench.recordings.recording import Stopped
from servobench.rig.devices.base import DEVICES, RunEnded, finite_voltage
from servobench.rig.wire.conversation import ENDLESS, PATIENCE, Conversation, Port
from servobench.rig.wire.messages import protocol
from servobench.rig.wire.serial_port import SerialPort
from servobench.systems.control.base import Controller
from servobench.systems.control.pi import Pi

NAME = "rig"
BOOT_TIME = 4.0  # s; a board that is reset by the opening of its port runs its boot loader first
HELLO_TIME = 0.25  # s; without an answer the board is asked again
GREETING_TIME = (
    8.0  # s, by the computer's clock: whoever talks on for twice as long as a board starts is no rig
)
BLOCK_PERIOD = 2  # ticks; slower samples come one by one, as eight of them would take too long
LEAD = 120  # duties that the board is to hold in advance, of the 128 that it can: 240 ms at 500 Hz
LATCH_TO_DUTY = (
    30e-6  # s; from a sample's latch to the duty that a table puts out with it, by the firmware in simavr
)
LATCH_TO_LAW = 120e-6  # s; the same to the duty that the board's law sets
CONVERTER = 5.0 / 1024  # V; a step of the board's converter
LARGEST_GAIN = 2**24
PERIODS_WATCHED = 2  # the watchdog has to last for as many sample times
FAULTS = {
    "watchdog": "its watchdog tripped: no voltage came for {watchdog_ms} ms; close what keeps the computer busy, or give it more "
    "time (watchdog = 200 ms)",
    "stall": "the shaft stood still for 3 s although it was driven, and the board cut the motor off; check what blocks it, and "
    "whether the encoder is connected",
    "encoder": "the encoder made transitions that no encoder makes; look at its plug, its supply and the length of its cable",
    "table_empty": "the voltages of a run came too late; close what keeps the computer busy",
    "overload": "the encoder was faster than the board can count (about 100,000 counts/s)",
    "hardware_watchdog": "its program hung and the board restarted itself; the position is lost",
    "brown_out": "its supply broke down and the board restarted itself; the position is lost. Give motor and board supplies of "
    "their own",
}
"""The meaning of each fault of the firmware for the person beside the motor."""
LATE = ("watchdog", "table_empty")  # faults by which a board ends the run of a computer that is too slow


class RigSettings(Settings):
    """The board's port, and what is connected to it."""

    port: Annotated[str, Field(min_length=1)]
    """Name of the serial port, such as /dev/ttyUSB0 or COM3."""
    baud: Annotated[int, Field(gt=0)] = 500_000
    """Rate of the serial port; 115200 for the firmware that was built for it."""
    counts_per_rev: CountsPerRev = 2048
    """Counts of the encoder in a revolution of the shaft: four times its lines, times the gear's ratio."""
    supply: PositiveVoltage = 12.0
    """Voltage of the motor's supply, at the bridge [V]."""
    watchdog: PositiveTime = 0.05
    """Time without a voltage after which the board cuts the motor off, 20 to 500 ms [s]."""
    stall_voltage: PositiveVoltage = 5.0
    """Voltage beyond which a shaft that stands still for 3 s is stalled [V]."""
    current_scale: Resistance | None = None
    """Volts of the current sensor for an ampere, 0.185 for an ACS712-05B; without it there is no current channel [Ω]."""
    current_offset: Annotated[float, Field(ge=0, le=5)] = 2.5
    """Volts of the current sensor without a current [V]."""
    batch: bool = True
    """Whether the board does by itself what it can: voltages that are known in advance from a table, and the law `pi`."""


class _Law(NamedTuple):
    """A PI law as the board computes it, in duties and counts."""

    mode: str
    """Of the board: position or speed."""
    kp: int
    """2^16 for a duty of 1 from an error of a count or a count per second."""
    ki: int
    """2^24 for the same in each sample."""
    limit: int
    """The largest duty."""
    counts: float
    """Counts in a radian."""

    @classmethod
    def of(cls, law: Pi, settings: RigSettings, sample_time: float, limit: float) -> Self | None:
        """Return the law for a board; None where it can't hold its gains, or would round one off by more than 1 in 1000."""
        counts = settings.counts_per_rev / (2 * math.pi)
        full = protocol().constants["duty_full"]
        of_a_count = full / settings.supply / counts  # duties for a volt per radian
        exact = (2**16 * of_a_count * law.kp, 2**24 * of_a_count * law.ki * sample_time)
        gains = [round(each) for each in exact]
        largest = math.floor(min(1.0, limit / settings.supply) * full)
        holds = all(0 <= each <= LARGEST_GAIN for each in gains) and largest >= 1
        if not holds or any(abs(each - by) > 1e-3 * abs(by) for each, by in zip(gains, exact, strict=True)):
            return None
        return cls(law.output, gains[0], gains[1], largest, counts)


@DEVICES.member(NAME)
class Rig:
    """A motor at the open rig. The board keeps the time, in ticks of 1 ms; whatever goes wrong ends at zero volts.

    In a run whose voltages are known in advance (`preload`) the board puts them out by its own clock from a table that is kept
    filled, and sends samples eight at a time, so that 1 kHz fits through 115,200 baud. Any voltage that differs from the table
    ends it, and is put out at once. `open_port` opens the port, given its name and rate.

    Raises `UsageError` for settings that no rig has.
    """

    Settings: ClassVar[type[RigSettings]] = RigSettings
    address: ClassVar[str] = "port"
    """The setting that may stand behind a colon: rig:/dev/ttyUSB0."""

    def __init__(self, settings: RigSettings, *, open_port: Callable[[str, int], Port] = SerialPort) -> None:
        limits = protocol().constants
        milliseconds = round(settings.watchdog * 1000)
        if not limits["watchdog_min_ms"] <= milliseconds <= limits["watchdog_max_ms"]:
            raise UsageError(
                f"rig: the watchdog is {milliseconds} ms; expected {limits['watchdog_min_ms']} to "
                f"{limits['watchdog_max_ms']} ms: it can't be switched off"
            )
        self.settings = settings
        self._open_port = open_port
        self._full: int = limits["duty_full"]
        self._watchdog_ms = milliseconds
        self._owner = secrets.randbelow(0xFFFF) + 1
        self._talk: Conversation | None = None
        self._firmware = ""
        self._running = False
        self._driving = False
        self._preloaded: tuple[int, ...] = ()
        self._law: _Law | None = None
        self._following: _Law | None = None
        self._table: tuple[int, ...] = ()
        self._forget()

    @property
    def info(self) -> DeviceInfo:
        """The device's description; if the board puts voltages out by its own clock, with the delay of that."""
        supply = self.settings.supply
        voltage = Channel(
            name="voltage", unit="V", minimum=-supply, maximum=supply, resolution=supply / self._full
        )
        counts = Channel(
            name="counts",
            unit="counts",
            resolution=1.0,
            counter_bits=32,
            counts_per_rev=self.settings.counts_per_rev,
        )
        channels = [voltage, counts]
        if (scale := self.settings.current_scale) is not None:
            channels.append(Channel(name="current", unit="A", resolution=CONVERTER / scale))
        by_itself = self._preloaded or self._law
        if not by_itself:
            channels.append(Channel(name="held_since", unit="s"))
        settings = self.settings.model_dump(exclude_defaults=True)
        if self._law:
            settings["law"] = "the board's"
        return DeviceInfo(
            name=NAME,
            serial=self.settings.port,
            channels=tuple(channels),
            delay=LATCH_TO_LAW if self._law else LATCH_TO_DUTY if self._preloaded else 0.0,
            timing="device",
            settings=(
                *((name, str(value)) for name, value in settings.items()),
                *((("firmware", self._firmware),) if self._firmware else ()),
            ),
        )

    @property
    def own_watchdog(self) -> float:
        """Time without a voltage after which the board cuts the motor off by itself [s]."""
        return self._watchdog_ms / 1000

    @property
    def opening_time(self) -> float:
        """Time for which no answer is normal while the port is being opened [s]: boards that it resets start anew."""
        return BOOT_TIME

    def __enter__(self) -> Self:
        """Open the port, find the firmware there and claim the board; the bridge is off."""
        talk = Conversation(self._open_port(self.settings.port, self.settings.baud), self.settings.port)
        try:
            self._greet(talk)
            self._talk = talk
            self._claim()
        except BaseException:
            self._talk = None
            with suppress(OSError):
                talk.port.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop, give the board back, and close the port."""
        self.stop()
        talk, self._talk, self._running, self._preloaded, self._law = self._talk, None, False, (), None
        if talk is not None:
            with suppress(OSError):
                talk.say("release", owner=self._owner)
            talk.port.close()

    def preload(self, voltages: Sequence[float] | Array) -> None:
        """Take the voltages (N,) [V] of the next run in advance: what its writes are going to be, tick by tick."""
        periodic = self.settings.batch and len(voltages)
        self._preloaded = tuple(self._duty(float(each)) for each in voltages) if periodic else ()

    def take_law(self, law: Controller | None, sample_time: float, limit: float) -> bool:
        """Take the law `pi` of the next run; at sample times above 2 ms, or with gains that it can't hold, the board doesn't."""
        self._law = None
        if isinstance(law, Pi) and self.settings.batch and sample_time * 1e3 <= BLOCK_PERIOD * (1 + 1e-6):
            self._law = _Law.of(law, self.settings, sample_time, limit)
        return self._law is not None

    def follow(self, reference: float) -> float:
        """Send the reference of the board's law, once for each block of samples; return what it put out with the last sample."""
        talk = self._needs_port()
        if not math.isfinite(reference):
            raise UsageError(f"rig: {reference!r} isn't a reference; expected a finite number")
        if self._following and not self._samples:
            counts = round(self._following.counts * reference)
            try:
                talk.say("reference", owner=self._owner, reference=max(-(2**31), min(2**31 - 1, counts)))
            except OSError as error:
                self._raise_lost(error)
        return self._reported_duty / self._full * self.settings.supply

    def start(self, sample_time: float, seed: int | None) -> None:
        """Switch the bridge on at zero volts and begin sampling; the sample time has to be a whole number of milliseconds."""
        talk = self._needs_port()
        period = self._period(sample_time)
        self._stop_and_claim(talk)
        # The run before may have left the board sampling, as one that ended in a fault does: making up those frames would keep it
        # from taking the table as fast as it comes.
        self._command("sampling", period=0, block=0)
        stall = min(self._full, max(1, self._duty(min(self.settings.stall_voltage, self.settings.supply))))
        self._command("configure", watchdog_ms=self._watchdog_ms, stall_duty=stall)
        self._table = self._preloaded
        self._forget()
        self._following = law = self._law
        if law:
            self._command("gains", kp=law.kp, ki=law.ki, limit=law.limit)
        self._command(
            "enable",
            mode=protocol().codes["modes"][law.mode if law else "table" if self._table else "direct"],
        )
        self._sample_time = period * protocol().constants["tick_us"] * 1e-6
        self._blocks = bool(self._table or law) and period <= BLOCK_PERIOD
        while self._table and self._sent < min(LEAD, len(self._table)):
            self._send_table()
        self._command("sampling", period=period, block=int(self._blocks))
        self._samples.clear()  # of the sampling before
        self._reported.clear()
        self._running = self._driving = True

    def read(self) -> Sample:
        """Wait for the next sample. Raises `RunEnded` where the board has cut the motor off, `DeviceError` where it is gone."""
        talk = self._needs_port()
        if not self._running:
            raise UsageError("rig: no run was started; call start() first")
        most = talk.received + ENDLESS
        while not self._samples:
            try:
                for name, values in talk.hear():
                    self._take(name, values)
            except OSError as error:
                self._raise_lost(error)
            if talk.silent > PATIENCE or talk.received > most:
                raise DeviceError(
                    f"rig: no sample came from {self.settings.port} for {PATIENCE:g} s; check its supply and its cable"
                )
        sample = self._samples.popleft()
        self._tick = sample.index
        self._reported_duty = self._reported.popleft()
        return sample

    def write(self, voltage: float) -> float:
        """Put a voltage out, and return it as the bridge puts it out: within the supply, in 1024 steps of it."""
        talk = self._needs_port()
        duty = self._duty(finite_voltage(NAME, voltage))
        if not self._driving:
            return 0.0
        try:
            if self._table and duty == self._due():
                self._keep_filled()
            elif not (self._following and duty == self._reported_duty):
                self._table, self._following = (), None
                talk.say("duty", owner=self._owner, duty=duty)
        except OSError as error:
            self._raise_lost(error)
        return duty / self._full * self.settings.supply

    def findings(self) -> tuple[Finding, ...]:
        """Return the warning that the board let the motor go because the voltages came too late, if it did."""
        return self._findings

    def stop(self) -> None:
        """Switch the bridge off. Where the port is gone the board's watchdog does it."""
        self._driving = False
        self._table, self._following = (), None
        if self._talk is not None:
            for _ in range(2):  # a frame may be damaged
                with suppress(OSError):
                    self._talk.say("stop")

    # The beginning

    def _greet(self, talk: Conversation) -> None:
        """Wait for the firmware to answer, and make sure that it speaks the same protocol."""
        most, until = talk.received + ENDLESS, monotonic() + GREETING_TIME
        for _ in range(round(BOOT_TIME / HELLO_TIME)):
            talk.silent = 0.0
            talk.say("hello", schema=protocol().schema)
            while talk.silent < HELLO_TIME and talk.received < most and monotonic() < until:
                if self._finds_firmware(talk):
                    return
        instead = ", though something is sent there" if talk.received else ""
        raise DeviceError(
            f"rig: no board at {self.settings.port} speaks the rig's protocol at {self.settings.baud} baud{instead}; flash the "
            "firmware (make -C firmware flash), or give the port and the baud rate it was built for"
        )

    def _finds_firmware(self, talk: Conversation) -> bool:
        """Return whether the firmware has answered; raises `DeviceError` if it speaks another protocol."""
        for name, values in talk.hear():
            if name != "info":
                continue
            if values["schema"] != protocol().schema:
                raise DeviceError(
                    f"rig: the firmware at {self.settings.port} speaks another protocol (schema {values['schema']:08x}, "
                    f"expected {protocol().schema:08x}); flash the one that belongs to this version: make -C firmware flash"
                )
            self._firmware = f"version {values['firmware']}, schema {values['schema']:08x}"
            return True
        return False

    def _claim(self) -> None:
        """Become the owner of the board, whatever an earlier owner left."""
        talk = self._needs_port()
        for _ in range(10):  # what is under way of an earlier conversation
            if not list(talk.hear()):
                break
        self._stop_and_claim(talk)

    def _stop_and_claim(self, talk: Conversation) -> None:
        """Come to the state `ready`, from whichever it is in."""
        states = protocol().codes["states"]
        if talk.ask("stop")["state"] == states["fault"]:
            talk.ask("clear")
        self._command("claim", schema=protocol().schema)

    def _command(self, message: str, **values: Any) -> None:
        """Send a command of the owner; raises `DeviceError` where the board refuses it."""
        status = self._needs_port().ask(message, owner=self._owner, **values)
        if status["refusal"]:
            names = {code: name for name, code in protocol().codes["refusals"].items()}
            why = protocol().meanings[f"refusals.{names[status['refusal']]}"]
            raise DeviceError(
                f"rig: the board at {self.settings.port} refused {message}: {why[0].lower()}{why[1:]} Reset it, then try again"
            )

    def _period(self, sample_time: float) -> int:
        if not (math.isfinite(sample_time) and sample_time > 0):
            raise UsageError(f"rig: the sample time is {sample_time!r}; expected a finite time above 0 s")
        ticks = sample_time * 1e6 / protocol().constants["tick_us"]
        if abs(ticks - round(ticks)) > 1e-6 * ticks or not 1 <= round(ticks) <= 255:
            raise UsageError(
                f"rig: the sample time is {sample_time * 1e3:g} ms; expected a whole number of milliseconds from 1 to 255"
            )
        if round(ticks) * PERIODS_WATCHED > self._watchdog_ms:
            raise UsageError(
                f"rig: the sample time of {round(ticks)} ms is too long for a watchdog of {self._watchdog_ms} ms, which would "
                f"trip; give it {PERIODS_WATCHED} sample times at least: watchdog = {PERIODS_WATCHED * round(ticks)} ms"
            )
        return round(ticks)

    # Samples

    def _forget(self) -> None:
        """Begin a run: nothing was sent or heard of it."""
        self._samples: deque[Sample] = deque()
        self._findings: tuple[Finding, ...] = ()
        self._reported: deque[int] = deque()  # the duties that came with them
        self._reported_duty = 0
        self._first_time: int | None = None
        self._held_since = 0.0
        self._last_duty = 0
        self._tick = -1  # of the sample that was read last
        self._sent = 0
        self._gap_at = -1
        self._blocks = False
        self._sample_time = math.nan

    def _take(self, name: str, values: dict[str, Any]) -> None:
        if name == "sample":
            self._take_sample(values)
        elif name == "block":
            self._take_block(values)
        elif name == "status":
            self._take_status(values)

    def _take_sample(self, values: dict[str, Any]) -> None:
        time = self._time(values["time"])
        age = values["age"]
        if values["duty"] != self._last_duty or age < 0xFFFF:
            self._held_since = time - 4e-6 * age
        self._last_duty = values["duty"]
        self._add(values["index"], time, values["position"], values["current"], self._held_since)
        self._reported.append(values["duty"])

    def _take_block(self, values: dict[str, Any]) -> None:
        first, position = values["index"], values["position"]
        begun = self._time(values["time"])
        for k, (delta, current) in enumerate(zip((0, *values["delta"]), values["current"], strict=True)):
            position = (position + delta + 2**31) % 2**32 - 2**31
            self._add(first + k, begun + k * self._sample_time, position, current, None)
        self._reported.extend(values["duty"])
        self._check_output(first, values)

    def _check_output(self, first: int, values: dict[str, Any]) -> None:
        """Hold what a block says was put out against the table; a fault that explains a difference is told by its own status."""
        if not self._table or values["faults"]:
            return
        expected = self._table[first : first + len(values["duty"])]
        if tuple(values["duty"][: len(expected)]) != expected:
            raise DeviceError(
                f"rig: the board put out {values['duty']} of {self._full} from sample {first} on; expected {expected}"
            )

    def _take_status(self, values: dict[str, Any]) -> None:
        codes = protocol().codes
        if values["refusal"] == codes["refusals"]["gap"] and values["table_next"] != self._gap_at:
            self._sent = self._gap_at = values["table_next"]  # a frame was lost: go on from there
        if not self._running:
            return
        names = protocol().names("faults", values["faults"])
        if "hardware_watchdog" in names or "brown_out" in names:
            raise DeviceError(f"rig: {FAULTS[names[0]]}")
        if names and self._driving:
            self._driving = False
            sentence = f"rig: {FAULTS[names[0]]}".format(**values)
            if names[0] in LATE:
                self._findings = (warning("voltages-late", f"{sentence[0].upper()}{sentence[1:]}."),)
            raise RunEnded(Stopped(reason="fault", sentence=sentence))
        if values["owner"] != self._owner:
            causes = " and ".join(protocol().names("reset_causes", values["reset_cause"])) or "unknown cause"
            raise DeviceError(
                f"rig: the board restarted ({plain_words(causes)}) or was claimed by another program; the position is lost"
            )

    def _time(self, ticks: int) -> float:
        """The time since the run's first sample [s]; the board's 32 bits of it wrap after 50 days."""
        if self._first_time is None:
            self._first_time = ticks
        return ((ticks - self._first_time) & 0xFFFFFFFF) * protocol().constants["tick_us"] * 1e-6

    def _add(self, index: int, time: float, position: int, current: int, held_since: float | None) -> None:
        scale = self.settings.current_scale
        self._samples.append(
            Sample(
                index=index,
                time=time,
                counts=position,
                current=None
                if scale is None
                else ((current + 0.5) * CONVERTER - self.settings.current_offset) / scale,
                held_since=held_since,
            )
        )

    # Voltages

    def _duty(self, voltage: float) -> int:
        """The duty that comes nearest to a voltage [V]."""
        part = max(-1.0, min(1.0, voltage / self.settings.supply))
        return round(part * self._full)

    def _due(self) -> int | None:
        """The table's voltage for the sample that was read last; None after its end."""
        return self._table[self._tick] if self._tick < len(self._table) else None

    def _keep_filled(self) -> None:
        """Send on as far as the board is to hold; what it is sent says, too, that the loop is alive."""
        every = protocol().constants["block_samples"] if self._blocks else 1
        if (self._tick + 1) % every:
            return
        self._send_table()
        while self._sent < min(self._tick + LEAD, len(self._table)):
            self._send_table()

    def _send_table(self) -> None:
        size = protocol().constants["table_chunk"]
        chunk = self._table[
            self._sent : self._sent + min(size, max(0, self._tick + LEAD + size - self._sent))
        ]
        padded = [*chunk, *([0] * (size - len(chunk)))]
        ends = self._sent + len(chunk) >= len(self._table)
        self._needs_port().say(
            "table", owner=self._owner, first=self._sent, count=len(chunk), last=int(ends), duty=padded
        )
        self._sent += len(chunk)

    def _needs_port(self) -> Conversation:
        if self._talk is None:
            raise DeviceError("rig: it isn't connected; use it inside a with statement")
        return self._talk

    def _raise_lost(self, error: OSError) -> None:
        """Say that the port is gone, unless it is our own word already."""
        if isinstance(error, DeviceError):
            raise error
        raise DeviceError(
            f"rig: the port {self.settings.port} is gone ({error.strerror or error}); without it the board cuts the motor off "
            f"after {self._watchdog_ms} ms"
        ) from error
