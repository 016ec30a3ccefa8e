"""The motor as the pages see it: one loop, one operator, everybody's STOP, and what is recorded meanwhile.

All of it happens in the server's thread, between two of its waits, and none of it waits itself: what takes time is done by
threads and processes, and reported back here.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Mapping
from contextlib import AbstractContextManager
from functools import partial
from typing import Any

from pydantic import ValidationError

from servobench.errors import ServobenchError, UsageError
from servobench.experiment import DeviceChoice, Experiment
from servobench.loop.messages import Command, Notice, info_to_json
from servobench.loop.process import LoopProcess
from servobench.panel.frames import History, speed_chain
from servobench.panel.library import Library
from servobench.panel.live_process import LiveProcess, live_of
from servobench.panel.opening import LIVE, Opening
from servobench.panel.pump import Loop, News, Pump
from servobench.panel.taking import BY_HAND, Taking
from servobench.panel.viewers import Viewer, as_text
from servobench.recording.recording import Stopped
from servobench.stopping_rule import parse_wish

OPERATOR_TIMEOUT = 1.0  # s; the loop's own, where nothing of ours gets through to it any more
SIGN_INTERVAL = 0.1  # s between two signs of life to the loop
STATE_INTERVAL = 0.2  # s between two states where nothing but counts has changed
_LIMITED_FOR = 0.5  # s for which a limit's light stays on
ASSIGNED = "assigned"
"""The device that is somebody's own in an assessment: a panel that has it keeps it."""
_SIMULATED = ("twin", ASSIGNED)

LoopOf = Callable[[Experiment], AbstractContextManager[Loop]]
LiveOf = Callable[[Loop, float, Mapping[str, float]], LiveProcess | None]


def own_process(experiment: Experiment) -> AbstractContextManager[Loop]:
    """Return a loop in a process of its own, as the panel wants it."""
    return LoopProcess(experiment, when_faulted="hold", enabled=False, operator_timeout=OPERATOR_TIMEOUT)


class Refusal(UsageError):
    """What somebody asked for can't be done now, or not by them; the message says why."""


class MotorSession:
    """What the pages share. `experiment` says what is there at the start; `loop_of` makes the loop of an experiment.

    `live_of` makes what identifies it meanwhile.

    The motor turns only while the operator, who has the lease, is connected: `leave` puts out zero volts at once. The loop gets
    a sign of life while an operator is there, or once it has said that it puts out zero volts; otherwise it ends by itself.
    """

    def __init__(
        self,
        experiment: Experiment,
        library: Library,
        loop_of: LoopOf = own_process,
        live_of: LiveOf = live_of,
    ) -> None:
        self.experiment = for_panel(experiment)
        self.library = library
        self.viewers: set[Viewer] = set()
        self.operator: Viewer | None = None
        self.history = History()
        self._signal = self.experiment.signal  # the one that was asked for last, in force or not yet
        self._wish: dict[str, float] = {}
        self._live: LiveProcess | None = None
        self._live_of = live_of
        self._loop_of = loop_of
        self._context: AbstractContextManager[Loop] | None = None
        self.loop: Loop | None = None
        self._pump: Pump | None = None
        self._opening: Opening | None = None
        self._closed_by = ""  # why no device is open, where one was
        self._changing = asyncio.Lock()
        self._signs: asyncio.Task[None] | None = None
        self.enabled = False
        self._last_enable = self._heard = 0  # numbers of commands
        self._fault: dict[str, str] | None = None
        self._late = self._missed = self._command = 0
        self._limited_until = 0.0
        self._state_due = 0.0
        self._taking: Taking | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    # --- the loop

    async def begin(self) -> None:
        """Open the device in the background, and begin to show the loop that somebody is there."""
        self._signs = asyncio.create_task(self._show_signs())
        self._later(self._open_or_tell())

    async def close(self) -> None:
        """End everything; the motor is at rest then."""
        async with self._changing:  # a device that is being opened is open first
            await self._close_loop("the panel ends")
        if self._signs is not None:
            self._signs.cancel()
        for task in tuple(self._tasks):
            task.cancel()

    async def open(self, experiment: Experiment) -> None:
        """Open the experiment's device in the place of the one before; raises what keeps it from beginning."""
        async with self._changing:
            self._opening = Opening(experiment.device.name)
            self.show_state()
            try:
                await self._close_loop("another device is being opened")
                self.experiment = for_panel(experiment)
                self._signal = self.experiment.signal
                await self._open_loop(self._opening)
            except BaseException:
                await self._close_loop("it couldn't be opened")
                raise
            finally:
                self._opening = None
                self.show_state()

    async def _open_loop(self, opening: Opening) -> None:
        context = self._loop_of(self.experiment)
        loop = await asyncio.to_thread(context.__enter__)
        self._context, self.loop = context, loop
        self.history = History()
        self.enabled, self._fault, self._closed_by = False, None, ""
        self._last_enable = self._heard = self._late = self._missed = self._command = 0
        for viewer in self.viewers:
            viewer.next_row = 0
        opening.doing = LIVE
        self.show_state()
        server = asyncio.get_running_loop()
        hand_on = partial(_to_thread_of, server, partial(self.take, loop))
        self._live = await asyncio.to_thread(self._live_of, loop, self.experiment.sample_time, self._wish)
        self._pump = Pump(loop, self.experiment.sample_time, self.experiment.chain, hand_on, self._live)
        self._pump.start()

    async def _open_or_tell(self) -> None:
        try:
            await self.open(self.experiment)
        except ServobenchError as error:
            self._fault = {"code": "device-not-opened", "sentence": str(error)}
            self.tell({"kind": "fault", **self._fault})
            self.show_state()

    async def _close_loop(self, why: str) -> None:
        pump, live, context = self._pump, self._live, self._context
        self._pump = self._live = self._context = self.loop = None
        self.enabled = False
        if pump is not None:
            await asyncio.to_thread(pump.close)
        if live is not None:
            await asyncio.to_thread(live.close)
        if self._taking is not None:
            self._taking.end(why)
            await self._ending_of(self._taking)
        if context is not None:
            await asyncio.to_thread(context.__exit__, None, None, None)

    async def _show_signs(self) -> None:
        while True:
            # Until there is a pump the device is still being opened, and at zero volts.
            watched = self._pump is None or self._pump.is_alive()
            if self.loop is not None and watched and self._may_go_on:
                self.loop.here()
            await asyncio.sleep(SIGN_INTERVAL)

    @property
    def _may_go_on(self) -> bool:
        """Whether somebody is there for the motor, or it is known to be at zero volts."""
        return self.operator is not None or (not self.enabled and self._heard >= self._last_enable)

    # --- who is there

    def join(self, viewer: Viewer) -> None:
        """Show everything to a viewer from now on, the last ten seconds at once."""
        self.viewers.add(viewer)
        viewer.show("state", as_text(self.state_for(viewer)))
        viewer.wake()

    def leave(self, viewer: Viewer) -> None:
        """Forget a viewer; where it was the operator, zero volts are put out."""
        self.viewers.discard(viewer)
        if self.operator is viewer:
            self._without_operator("the operator's page is gone; zero volts are put out")

    def take_lease(self, viewer: Viewer) -> None:
        """Make a viewer the operator; raises `Refusal` where another one is."""
        if viewer.role != "operator":
            raise Refusal("this page may watch, and stop the motor; it can't drive it")
        if self.operator not in (None, viewer):
            raise Refusal("another page drives the motor; it has to let go first")
        self.operator = viewer
        self.show_state()

    def release(self, viewer: Viewer) -> None:
        """Let go of the motor, at zero volts."""
        self.check_operator(viewer)
        self._without_operator("the operator has let go; zero volts are put out")

    def check_operator(self, viewer: Viewer) -> None:
        """Raise `Refusal` for all but the operator."""
        if self.operator is not viewer:
            raise Refusal("this page doesn't drive the motor: take the lease first")

    def _without_operator(self, sentence: str) -> None:
        self.operator = None
        if self.loop is not None:
            self.loop.command(Command(enabled=False))
        if self.enabled or self._heard < self._last_enable:
            self.tell({"kind": "stopped", "sentence": sentence})
        self.show_state()

    # --- commands

    def command(self, command: Command) -> int:
        """Give the loop a command and return its number; raises `Refusal` where no loop goes on."""
        loop = self._going_on()
        number = loop.command(command)
        if command.enabled:
            self._last_enable = number
        if command.signal is not None:
            self._signal = command.signal
        return number

    def start(self) -> int:
        """Let the controller's voltage through; the signal begins at its own time 0."""
        return self.command(Command(enabled=True, signal=self._signal))

    def stop(self, sentence: str) -> None:
        """Put out zero volts, whoever asks."""
        if self.loop is not None:
            self.loop.command(Command(enabled=False))
        self.tell({"kind": "stopped", "sentence": sentence})

    def acknowledge(self) -> int | None:
        """Acknowledge a fault, so that the motor may turn again, once it's started; None where it ended the loop."""
        self._fault = None
        self.show_state()
        if self.loop is None:
            return None
        return self.command(Command(acknowledge=True, enabled=False))

    def _going_on(self) -> Loop:
        if self._opening is not None:
            raise Refusal("the device is being opened: wait until it is open")
        if self.loop is None:
            raise Refusal("no device is open: open one first")
        return self.loop

    def wish(self, until: str) -> None:
        """Say from which intervals on what is known is enough, such as `time_constant=0.5%`; raises `UsageError`."""
        self._wish = dict(parse_wish(until))
        if self._live is not None:
            self._live.set_wish(self._wish)

    # --- what is recorded

    async def record(self, name: str | None, duration: float | None) -> str:
        """Begin a recording and return its name; raises `Refusal` where one goes on, and as `Library.new`."""
        loop = self._going_on()
        if self._taking is not None:
            raise Refusal(f"{self._taking.folder.name} is being recorded: end that first")
        taking = self._taking = Taking(loop, self.experiment, self.library.new(name), duration)
        self.show_state()
        try:
            await taking.begin()
        except ServobenchError:
            self._taking = None
            self.library.forget(taking.folder)
            raise
        return taking.folder.name

    def end_record(self) -> None:
        """End the recording with the row that is the last one now; raises `Refusal` where there is none."""
        if self._taking is None:
            raise Refusal("nothing is being recorded")
        self._taking.end(BY_HAND)

    def _ending_of(self, taking: Taking) -> asyncio.Task[None]:
        """What takes note of a recording's end; it happens once."""
        if taking.ending is None:
            taking.ending = self._later(self._end_taking(taking))
        return taking.ending

    @property
    def recorded_now(self) -> str | None:
        """The name of the recording that is being made, if one is."""
        return None if self._taking is None else self._taking.folder.name

    async def _end_taking(self, taking: Taking) -> None:
        """Take note of a recording's end, whatever end it is."""
        error = await taking.finish()
        self._taking = None
        if error:
            self._unrecorded(error)
        else:
            self.tell({"kind": "recorded", **taking.outcome()})
        self.tell({"kind": "library"})
        self.show_state()

    def _unrecorded(self, sentence: str) -> None:
        """What is to be recorded and can't be stops the motor: nothing turns unrecorded that somebody thinks is."""
        if self.loop is not None:
            self.loop.command(Command(enabled=False))
        self._fault = {"code": "recording-failed", "sentence": f"{sentence}; zero volts are put out"}
        self.tell({"kind": "fault", **self._fault})

    # --- what comes from the loop

    def take(self, loop: Loop, news: News) -> None:
        """Take what came from the loop, and show it to everybody."""
        if loop is not self.loop:
            return  # one that was closed meanwhile
        for event in news.events:
            self._happened(event)
        counts = (news.late, news.missed)
        changed = counts != (self._late, self._missed)
        self._late, self._missed = counts
        if len(news.values):
            self.history.add(news.first, news.values)
            self._command = int(news.values[-1, -1])
            self._note_limits(news)
            for viewer in self.viewers:
                viewer.wake()
        if news.live:
            for viewer in self.viewers:
                viewer.show("live", news.live)
        taking = self._taking
        if taking is not None and taking.over:
            self._ending_of(taking)
        if news.ended is not None:
            self._ended(news.ended)
        elif changed or taking is not None:
            self._show_counts()

    def _happened(self, event: Notice) -> None:
        if event.kind == "command":
            self._acknowledged(event)
        elif event.kind == "fault":
            self._fault = {"code": event.about["code"], "sentence": event.about["sentence"]}
            self.tell({"kind": "fault", **self._fault, "tick": event.tick, "time": event.time})
            self.show_state()
        elif event.kind == "acknowledged":
            self._fault = None
            self.show_state()

    def _acknowledged(self, event: Notice) -> None:
        """What the loop has taken is in force from now on, and not before."""
        about = event.about
        self.tell(
            {
                "kind": "applied",
                "number": about["number"],
                "tick": event.tick,
                "accepted": about["accepted"],
                "what": about["what"],
                "why": about["why"],
            }
        )
        self._heard = max(self._heard, about["number"] or 0)
        if not about["accepted"]:
            self._signal = self.experiment.signal
        else:
            taken = Command(**about["what"])
            if taken.enabled is not None:
                self.enabled = taken.enabled
            changes = {
                name: value
                for name in ("signal", "controller", "chain")
                if (value := getattr(taken, name)) is not None
            }
            self.experiment = self.experiment.model_copy(update=changes)
        self.show_state()

    def _ended(self, stopped: Stopped) -> None:
        self._closed_by = stopped.sentence
        if self._taking is not None:
            self._taking.end(stopped.sentence)
        self.tell({"kind": "stopped", "sentence": stopped.sentence})
        if stopped.reason in ("device_lost", "error", "fault"):
            self._fault = {"code": stopped.reason.replace("_", "-"), "sentence": stopped.sentence}
        self._later(self._closed())

    async def _closed(self) -> None:
        async with self._changing:
            await self._close_loop(self._closed_by)
        self.show_state()

    def _note_limits(self, news: News) -> None:
        saturated = news.values[:, -2] > 0
        if saturated.any():
            self._limited_until = float(news.values[saturated][-1, 0]) + _LIMITED_FOR

    # --- what is told

    def tell(self, message: Mapping[str, Any]) -> None:
        """Tell everybody."""
        for viewer in self.viewers:
            viewer.tell(message)

    def show_state(self) -> None:
        """Show everybody how things are."""
        if not self.viewers:
            return
        state = self._state()
        for_others = as_text({**state, "operator": False})
        for viewer in self.viewers:
            viewer.show(
                "state", as_text({**state, "operator": True}) if viewer is self.operator else for_others
            )

    def _show_counts(self) -> None:
        now = asyncio.get_running_loop().time()
        if now >= self._state_due:
            self._state_due = now + STATE_INTERVAL
            self.show_state()

    def state_for(self, viewer: Viewer) -> dict[str, Any]:
        """Return how things are, as one viewer sees it."""
        return {**self._state(), "operator": self.operator is viewer}

    def _state(self) -> dict[str, Any]:
        """How things are, for everybody; who the operator is differs."""
        asked = self.experiment.model_dump(mode="json", include={"signal", "controller"})
        return {
            "kind": "state",
            "running": self.loop is not None and self._opening is None,
            "opening": None if self._opening is None else self._opening.state(),
            "closed": self._closed_by,
            "enabled": self.enabled,
            "taken": self.operator is not None,
            "signal": asked["signal"],
            "controller": asked["controller"],
            "chain": self.experiment.chain,
            "sample_time": self.experiment.sample_time,
            "device": self.device(),
            "fault": self._fault,
            "late": self._late,
            "missed": self._missed,
            "limits": self._limits(),
            "recording": None if self._taking is None else self._taking.state(),
            "command": self._command,
        }

    def device(self) -> dict[str, Any]:
        """Return what the device is, as JSON can hold it."""
        known = {} if self.loop is None else info_to_json(self.loop.info)
        choice = self.experiment.device.model_dump(mode="json")
        return {**known, "name": choice["name"], "settings": choice["settings"]}

    def _limits(self) -> list[dict[str, str]]:
        """The limits that act at the moment, with a sentence each."""
        if not self.history.time < self._limited_until:
            return []
        limit = self.experiment.limits.voltage
        sentence = f"The voltage that was put out is less than what was commanded: ±{limit:g} V, or less, is the limit."
        return [{"code": "saturated", "sentence": sentence}]

    def _later(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task


def command_from(given: Mapping[str, Any]) -> Command:
    """Return the command that a page's message describes; raises `UsageError` for what can't be."""
    try:
        command = Command(**{key: value for key, value in given.items() if value is not None})
    except ValidationError as error:
        raise UsageError(_told(error)) from None
    if command.chain is not None:
        speed_chain(command.chain)
    return command


def experiment_from(now: Experiment, device: object, sample_time: object) -> Experiment:
    """Return the experiment with another device or sample time; raises `UsageError` for what can't be."""
    from servobench.devices.base import connect

    try:
        changed = now.model_dump()
        if device is not None:
            changed["device"] = device
        if sample_time is not None:
            changed["sample_time"] = sample_time
        asked = for_panel(Experiment(**changed))
    except ValidationError as error:
        raise UsageError(_told(error)) from None
    if now.device.name == ASSIGNED and asked.device != for_panel(now).device:
        raise Refusal("this panel has the motor that is assigned to you; it can't be changed for another")
    connect(asked.device.name, **asked.device.settings)  # not entered: its settings are checked by that
    return asked


def for_panel(experiment: Experiment) -> Experiment:
    """Return the experiment as the panel runs it: without an end, and a simulated motor in real time."""
    device = experiment.device
    if device.name in _SIMULATED:
        device = DeviceChoice(
            name=device.name, settings={**device.settings, "timing": "host"}, faults=device.faults
        )
    chain = experiment.chain or "derivative | lowpass 50 rad/s"
    return experiment.model_copy(update={"device": device, "duration": None, "until": "", "chain": chain})


def _told(error: ValidationError) -> str:
    return "; ".join(
        f"{'.'.join(map(str, each['loc']))}: {each['msg'].removeprefix('Value error, ')}"
        for each in error.errors(include_url=False)
    )


def _to_thread_of(server: asyncio.AbstractEventLoop, take: Callable[[News], None], news: News) -> None:
    """Hand news on to the server's thread; one that has ended takes none."""
    if not server.is_closed():
        server.call_soon_threadsafe(take, news)
