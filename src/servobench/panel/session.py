"""The motor as the pages see it: one loop, one operator, everybody's STOP, and what is recorded meanwhile.

Everything here runs in the server's thread and never blocks: slow work is done by other threads and processes, which report back.
"""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Mapping
from itertools import count
from time import monotonic
from typing import Any

from servobench.core.errors import ServobenchError
from servobench.identification.design.stopping_rule import parse_wish
from servobench.panel.attention import HIDDEN, SILENT
from servobench.panel.capture import BY_HAND, Capture, Captures
from servobench.panel.commands import SIMULATED, for_panel
from servobench.panel.connection import Connection, LiveOf, LoopContext, LoopOf
from servobench.panel.frames import History
from servobench.panel.lease import Lease, Refusal
from servobench.panel.library import Library
from servobench.panel.live_process import live_of
from servobench.panel.loop_status import LoopStatus, reply_data, with_changes
from servobench.panel.opening import LIVE, Opening
from servobench.panel.pump import Loop, News
from servobench.panel.viewers import Viewer, Viewers, as_text
from servobench.recordings.recording import Stopped
from servobench.rig.experiment import Experiment
from servobench.rig.loop.messages import Command, Notice, info_to_json
from servobench.rig.loop.process import LoopProcess

OPERATOR_TIMEOUT = 1.0  # s; the loop's own, where nothing of ours gets through to it any more
SIGN_INTERVAL = 0.1  # s between two looks at the operator's page, and signs of life to the loop
READ_TIME = 0.02  # s in which what pages said is read, where the server itself was held up: it isn't them who were silent
BEAT = 3  # of those there is one to the pages: they call it silence where they hear nothing for 1 s
STATE_INTERVAL = 0.2  # s between two states where nothing but counts has changed
_PANEL_ENDS = "the panel ends"


def own_process(experiment: Experiment) -> LoopContext:
    """Return a loop in a process of its own, as the panel wants it: ticks that are missed stop no motor that is simulated."""
    return LoopProcess(
        experiment,
        when_faulted="hold",
        enabled=False,
        operator_timeout=OPERATOR_TIMEOUT,
        missed_go_on=experiment.device.name in SIMULATED,
    )


class MotorSession:
    """The state that pages share. `experiment` says what is there at the start; `loop_of` makes the loop of an experiment.

    `live_of` makes what identifies it meanwhile.

    The motor turns only while the operator, who has the lease, sees it: `leave` and `hidden` put out zero volts at once, and so
    does a page whose own drawing says nothing for `attention.SILENCE`, or is behind by `attention.LAG`. The loop gets a sign of
    life while an operator is there, or once it has said that it puts out zero volts; otherwise it ends by itself.
    """

    def __init__(
        self,
        experiment: Experiment,
        library: Library,
        loop_of: LoopOf = own_process,
        live_of: LiveOf = live_of,
    ) -> None:
        self.experiment = for_panel(experiment)
        self.viewers = Viewers()
        self.lease = Lease()
        self.history = History()
        self.takings = Captures(library, self.show_state, self._note_recorded)
        self._signal = self.experiment.signal  # the one that was requested last, in force or not yet
        self._taken = False  # whether a page drives, as last announced
        self._wish: dict[str, float] = {}
        self._loop_of = loop_of
        self._live_of = live_of
        self._connection: Connection | None = None
        self._opening: Opening | None = None
        self._standing = LoopStatus()
        self._closed_by = ""  # why no device is open, where one was
        self._changing = asyncio.Lock()
        self._signs: asyncio.Task[None] | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._watched: LoopContext | None = None  # the loop that is open, being opened or being closed
        self._over = False  # the panel ends: nothing is opened any more
        self._dangers: dict[
            str, str
        ] = {}  # what is wrong at a device that was closed, by the device's settings
        self._rested = False  # whether zero volts were confirmed at the end of a device
        self._warned = 0  # how many of its warnings were told
        self._state_due = 0.0

    # --- the device

    @property
    def loop(self) -> Loop | None:
        """The loop that goes on; None where no device is open."""
        return None if self._connection is None else self._connection.loop

    async def begin(self) -> None:
        """Open the device in the background, and begin to send the loop its signs of life."""
        self._signs = asyncio.create_task(self._show_signs())
        self._later(self._open_or_tell())

    async def close(self) -> None:
        """End everything, the loop first; `last_word` then says what is known of the motor. May be called again."""
        self._over = True
        if self._watched is not None:
            self.takings.end(_PANEL_ENDS)
            await asyncio.to_thread(
                self._watched.rest
            )  # also while it is being opened, which isn't waited for
            self._tell_warnings()
        async with self._changing:
            await self._disconnect(_PANEL_ENDS)
        if self._signs is not None:
            self._signs.cancel()
        for task in tuple(self._tasks):
            task.cancel()

    @property
    def danger(self) -> str:
        """Problems at a motor whose loop has ended, with what to do; empty if there are none."""
        return "\n".join(self._dangers.values())

    @property
    def last_word(self) -> str:
        """The state of the motor after `close`."""
        return self.danger or ("the motor is at rest" if self._rested else "the motor was not driven")

    async def open(self, experiment: Experiment) -> None:
        """Open the experiment's device in the place of the one before.

        Raises what keeps it from beginning, and `Refusal` once the panel ends.
        """
        async with self._changing:
            if self._over:
                raise Refusal("the panel is closing: no device can be opened")
            self._opening = Opening(experiment.device.name)
            self.show_state()
            try:
                await self._disconnect("another device is being opened")
                self.experiment = for_panel(experiment)
                self._signal = self.experiment.signal
                await self._connect(self._opening)
            except BaseException:
                await self._disconnect("it couldn't be opened")
                raise
            finally:
                self._opening = None
                self.show_state()

    async def _connect(self, opening: Opening) -> None:
        self._watched, self._warned = self._loop_of(self.experiment), 0
        connection = self._connection = await Connection.begin(self._watched)
        self.history, self._standing, self._closed_by = History(), LoopStatus(), ""
        self.viewers.begin_anew()
        opening.doing = LIVE
        self.show_state()
        await connection.follow(self.experiment, self._live_of, self._wish, self.take)

    async def _open_or_tell(self) -> None:
        try:
            await self.open(self.experiment)
        except ServobenchError as error:
            self._fail("device-not-opened", str(error))
            self.show_state()

    async def _disconnect(self, why: str) -> None:
        connection, self._connection = self._connection, None
        self._standing.enabled = False
        if self._watched is not None:
            self.takings.end(why)
            await asyncio.to_thread(self._watched.rest)  # the motor first: what else ends may take its time
        if connection is not None:
            await connection.unfollow()
        await self.takings.finish(why)
        if connection is not None:
            await connection.end()
        self._tell_warnings()
        self._keep_what_is_known()
        self._watched = None

    def _keep_what_is_known(self) -> None:
        """Keep what the end of a loop says of the motor; zero volts that the same device confirmed later count."""
        if self._watched is None:
            return
        device = self.experiment.device.model_dump_json()
        if self._watched.danger:
            self._dangers[device] = self._watched.danger
        elif self._watched.zero_volts:
            self._rested = True
            self._dangers.pop(device, None)

    def _tell_warnings(self) -> None:
        """Tell everybody what the loop warns of, also while its device is being opened or closed."""
        warnings = () if self._watched is None else self._watched.warnings
        for sentence in warnings[self._warned :]:
            self._fail("switch-off", sentence)
            self.show_state()
        self._warned = len(warnings)

    async def _show_signs(self) -> None:
        for turn in count():
            self._look_at_operator()
            connection = self._connection
            if connection is not None and connection.watched and self._may_go_on:
                connection.loop.here()
            self._tell_warnings()
            if turn % BEAT == 0:
                self.viewers.heartbeat()
            slept = monotonic()
            await asyncio.sleep(SIGN_INTERVAL)
            if monotonic() - slept > 2 * SIGN_INTERVAL:
                await asyncio.sleep(READ_TIME)

    @property
    def _may_go_on(self) -> bool:
        """Whether a person watches the motor, or it is certain to be at zero volts."""
        return self.lease.taken or self._standing.rests

    # --- who is there

    def join(self, viewer: Viewer) -> None:
        """Show everything to a viewer from now on, the last ten seconds at once."""
        self.viewers.add(viewer)
        viewer.show("state", as_text(self.state_for(viewer)))
        viewer.wake()

    def leave(self, viewer: Viewer) -> None:
        """Forget a viewer; where it was the operator, zero volts are put out."""
        self.viewers.discard(viewer)
        if self.lease.operator is viewer:
            self._without_operator("the operator's page is gone; the voltage is zero")

    def note_seen(self, viewer: Viewer, row: int) -> None:
        """Take note that a viewer's page has drawn all rows before that number."""
        viewer.attention.heartbeat(row)
        self._show_whether_taken()

    def note_hidden(self, viewer: Viewer) -> None:
        """Take note that a viewer's page can't be seen; where it is the operator's, zero volts are put out."""
        viewer.attention.end()
        if viewer is self.lease.operator:
            self._stop_unseen(HIDDEN)

    def _look_at_operator(self) -> None:
        """Apply zero volts where the operator's page doesn't show the motor as it is."""
        viewer = self.lease.operator
        if viewer is not None and (why := viewer.attention.reason_unseen(self.history)):
            self._stop_unseen(why)
        self._show_whether_taken()

    def _stop_unseen(self, why: str) -> None:
        """Apply zero volts, once for each start; the operator stays unless another page asks to drive."""
        if self.loop is not None and not self._standing.rests and not self._standing.stopped:
            sentence = f"{why}; the voltage is zero"
            self.stop(sentence)
            self.takings.end(sentence)
            self.show_state()

    def _show_whether_taken(self) -> None:
        """Show everybody where the operator's page fell silent, or is back."""
        if self._taken != self.lease.taken:
            self._taken = self.lease.taken
            self.show_state()

    def take_lease(self, viewer: Viewer) -> None:
        """Make a viewer the operator, in the place of one that fell silent too; raises as `Lease.take`."""
        before = self.lease.operator
        self.lease.take(viewer)
        if before not in (None, viewer):
            self._stop_unseen(SILENT)
        self.show_state()

    def release(self, viewer: Viewer) -> None:
        """Let go of the motor, at zero volts; raises as `Lease.check`."""
        self.lease.check(viewer)
        self._without_operator("the operator released the motor; the voltage is zero")

    def _without_operator(self, sentence: str) -> None:
        self.lease.end()
        self._put_out_zero()
        self.takings.end(sentence)
        if not self._standing.rests:
            self._standing.stopped = sentence
            self.tell({"kind": "stopped", "sentence": sentence})
        self.show_state()

    # --- commands

    def command(self, command: Command) -> int:
        """Give the loop a command and return its number; raises `Refusal` where no loop goes on."""
        number = self._current_loop().command(command)
        if command.enabled:
            self._standing.last_enable, self._standing.stopped = number, ""
            if self.lease.operator is not None:
                self.lease.operator.attention.begin()
        if command.signal is not None:
            self._signal = command.signal
        return number

    def start(self) -> int:
        """Let the controller's voltage through; the signal begins at its own time 0."""
        return self.command(Command(enabled=True, signal=self._signal))

    def stop(self, sentence: str) -> int | None:
        """Apply zero volts, for any page; return the number that the loop acknowledges, None if no loop runs yet.

        What is being recorded goes on: how the shaft comes to rest is what shows that it was stopped.
        """
        number = self._put_out_zero()
        self._standing.stopped = sentence
        self.tell({"kind": "stopped", "sentence": sentence})
        return None if self._opening is not None else number

    def acknowledge(self) -> int | None:
        """Acknowledge a fault, so that the motor may turn again, once it's started; None where it ended the loop."""
        self._standing.fault = None
        self.show_state()
        if self.loop is None:
            return None
        return self.command(Command(acknowledge=True, enabled=False))

    def wish(self, until: str) -> None:
        """Say from which intervals on what is known is enough, such as `time_constant=0.5%`; raises `UsageError`."""
        self._wish = dict(parse_wish(until))
        if self._connection is not None and self._connection.live is not None:
            self._connection.live.set_wish(self._wish)

    def _current_loop(self) -> Loop:
        if self._opening is not None:
            raise Refusal("the device is being opened: wait until it is open")
        if self.loop is None:
            raise Refusal("no device is open: open one first")
        return self.loop

    def _put_out_zero(self) -> int | None:
        return None if self.loop is None else self.loop.command(Command(enabled=False))

    # --- what is recorded

    async def record(self, name: str | None, duration: float | None) -> str:
        """Begin a recording and return its name; raises as `Captures.begin`, and `Refusal` where no loop goes on."""
        return await self.takings.begin(self._current_loop, self.experiment, name, duration)

    def end_record(self) -> None:
        """End the recording with the row that is the last one now; raises `Refusal` where there is none."""
        if self.takings.now is None:
            raise Refusal("nothing is being recorded")
        self.takings.end(BY_HAND)

    def _note_recorded(self, capture: Capture, error: str) -> None:
        """Take note of a recording's end; one that failed stops the motor, so that it never turns unrecorded unnoticed."""
        if error:
            self._put_out_zero()
            self._fail("recording-failed", f"{error}; the voltage is zero")
        else:
            self.tell({"kind": "recorded", **capture.outcome()})
        if capture.loop is self.loop:
            self._later(asyncio.to_thread(capture.loop.ready_recorder))
        self.tell({"kind": "library"})
        self.show_state()

    # --- what comes from the loop

    def take(self, loop: Loop, news: News) -> None:
        """Take what came from the loop, and show it to everybody."""
        if loop is not self.loop:
            return  # one that was closed meanwhile
        for event in news.events:
            self._note_event(event)
        changed = self._standing.count(news)
        if len(news.values):
            self.history.add(news.first, news.values)
            if self._standing.see(news):
                self.show_state()
        self.viewers.show_news(news.live, bool(len(news.values)))
        self.takings.look()
        if news.ended is not None:
            self._note_end(news.ended)
        elif changed or self.takings.now is not None:
            self._show_counts()

    def _note_event(self, event: Notice) -> None:
        if event.kind == "command":
            self.tell(reply_data(event))
            taken = self._standing.hear(event)
            if taken is None:
                self._signal = self.experiment.signal
            else:
                self.experiment = with_changes(self.experiment, taken)
        elif event.kind == "fault":
            self._fail(event.about["code"], event.about["sentence"], tick=event.tick, time=event.time)
            self.takings.end(event.about["sentence"])
        elif event.kind == "acknowledged":
            self._standing.fault = None
        else:
            return
        self.show_state()

    def _note_end(self, stopped: Stopped) -> None:
        self._closed_by = stopped.sentence
        self.takings.end(stopped.sentence)
        self.tell({"kind": "stopped", "sentence": stopped.sentence})
        if stopped.reason in ("device_lost", "error", "fault"):
            code = stopped.reason.replace("_", "-")
            self._standing.fault = {"code": code, "sentence": stopped.sentence}
        self._later(self._note_closed())

    async def _note_closed(self) -> None:
        async with self._changing:
            await self._disconnect(self._closed_by)
        self.show_state()

    # --- messages

    def tell(self, message: Mapping[str, Any]) -> None:
        """Tell everybody."""
        self.viewers.tell(message)

    def _fail(self, code: str, sentence: str, **when: float) -> None:
        """Keep what is wrong, and tell everybody."""
        self._standing.fault = {"code": code, "sentence": sentence}
        self.tell({"kind": "fault", **self._standing.fault, **when})

    def show_state(self) -> None:
        """Show everybody how things are."""
        if self.viewers:
            self.viewers.show_state(self._state(), self.lease.operator)

    def _show_counts(self) -> None:
        now = asyncio.get_running_loop().time()
        if now >= self._state_due:
            self._state_due = now + STATE_INTERVAL
            self.show_state()

    def state_for(self, viewer: Viewer) -> dict[str, Any]:
        """Return how things are, as one viewer sees it."""
        return {**self._state(), "operator": self.lease.operator is viewer}

    def _state(self) -> dict[str, Any]:
        """The state for all viewers; who the operator is differs."""
        drive = self.experiment.model_dump(mode="json", include={"signal", "controller"})
        state, capture = self._standing, self.takings.now
        return {
            "kind": "state",
            "followed": self._connection is not None and self._connection.live is not None,
            "running": self.loop is not None and self._opening is None,
            "opening": None if self._opening is None else self._opening.state(),
            "closed": self._closed_by,
            "enabled": state.enabled,
            "stopped": state.stopped,
            "taken": self.lease.taken,
            "signal": drive["signal"],
            "controller": drive["controller"],
            "chain": self.experiment.chain,
            "sample_time": self.experiment.sample_time,
            "device": self.device(),
            "fault": state.fault,
            "late": state.late,
            "missed": state.missed,
            "limits": [] if self.loop is None else state.limits(self.experiment),
            "recording": None if capture is None else capture.state(),
            "command": state.command,
        }

    def device(self) -> dict[str, Any]:
        """Return what the device is, as JSON can hold it."""
        known = {} if self.loop is None else info_to_json(self.loop.info)
        choice = self.experiment.device.model_dump(mode="json")
        return {**known, "name": choice["name"], "settings": choice["settings"]}

    def _later(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task
