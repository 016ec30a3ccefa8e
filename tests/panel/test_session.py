"""One motor, one operator, everybody's STOP; in one thread, with a loop that is none."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servobench.core.errors import StorageError, UsageError
from servobench.panel.attention import Attention
from servobench.panel.capture import BY_HAND, Capture
from servobench.panel.lease import Refusal
from servobench.panel.library import Library
from servobench.panel.session import MotorSession
from servobench.panel.socket import ACTIONS, _answer
from servobench.panel.viewers import Viewer, Viewers
from servobench.recordings.recording import Stopped
from servobench.rig.experiment import Experiment
from servobench.systems.signals.constant import Constant
from servobench.systems.signals.sine import Sine
from tests.panel.doubles import LoopDouble, unidentified


class Room:
    """A session with a loop double, and pages that say things."""

    def __init__(self, folder: Path) -> None:
        self.loops: list[LoopDouble] = []
        self.motor = MotorSession(Experiment(), Library(folder), self._loop_of, unidentified)

    def _loop_of(self, experiment: Experiment) -> LoopDouble:
        self.loops.append(LoopDouble(experiment))
        return self.loops[-1]

    @property
    def loop(self) -> LoopDouble:
        return self.loops[-1]

    async def page(self, role: Any = "operator") -> Viewer:
        viewer = Viewer(role)
        self.motor.join(viewer)
        await heard(viewer)
        return viewer

    async def say(self, viewer: Viewer, **said: object) -> dict[str, Any]:
        """Say something, and return the answer."""
        await _answer(json.dumps({"id": 7, **said}), viewer, self.motor)
        answers = [message for message in await heard(viewer) if message["kind"] == "answer"]
        assert [answer["id"] for answer in answers] == [7]
        return answers[0]

    async def let_news_come(self) -> None:
        """Wait until the session has heard all that the loop has said so far."""
        assert self.motor._connection is not None
        pump = self.motor._connection.pump
        assert pump is not None
        said = self.loop._events.written
        while pump._events.next < said or self.motor.history.next < self.loop.ring.written:
            await asyncio.sleep(0.005)
        await asyncio.sleep(0.05)


async def heard(viewer: Viewer) -> list[dict[str, Any]]:
    """All that waits for a page."""
    return [json.loads(text) for text in await viewer.texts()]


def played(folder: Path, story: Callable[[Room], Awaitable[None]]) -> Room:
    """Let a story happen in a room."""
    room = Room(folder)

    async def all_of_it() -> None:
        await room.motor.open(room.motor.experiment)
        try:
            await asyncio.wait_for(story(room), 60)
        finally:
            await room.motor.close()

    asyncio.run(all_of_it())
    assert all(loop.left for loop in room.loops)
    return room


def test_only_the_operator_drives(tmp_path: Path) -> None:
    async def story(room: Room) -> None:
        one, two, looks_on = await room.page(), await room.page(), await room.page("viewer")

        assert (await room.say(one, do="lease"))["ok"]
        assert (await room.say(one, do="lease"))["ok"]  # it has it
        for other in (two, looks_on):
            refused = await room.say(other, do="lease")
            assert not refused["ok"]
        commands = len(room.loop.commands)
        for name, action in ACTIONS.items():
            if action.operates:
                for other in (two, looks_on):
                    assert "take control first" in (await room.say(other, do=name))["error"], name
        assert len(room.loop.commands) == commands

        assert (await room.say(one, do="release"))["ok"]
        assert (await room.say(two, do="lease"))["ok"]
        assert not (await room.say(one, do="start"))["ok"]
        assert "watch" in (await room.say(looks_on, do="lease"))["error"]

    played(tmp_path, story)


def test_of_ten_thousand_commands_of_two_pages_none_come_in_between(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(6)
    # Both pages are there all the time: on a busy machine one would fall silent, and the other take its place at rest.
    monkeypatch.setattr(Attention, "there", True)

    async def story(room: Room) -> None:
        pages = [await room.page(), await room.page()]
        done = 0
        holder: list[int] = []  # who had the lease when each command came to the loop

        async def press(who: int, wishes: list[float]) -> None:
            nonlocal done
            for wish in wishes:
                page = pages[who]
                if wish < 0.02:
                    await _answer(json.dumps({"do": "lease"}), page, room.motor)
                elif wish < 0.03:
                    await _answer(json.dumps({"do": "release"}), page, room.motor)
                    holder.extend([who] * (len(room.loop.commands) - len(holder)))  # its zero volts
                else:
                    value = {"type": "constant", "value": float(who)}
                    await _answer(json.dumps({"do": "set", "signal": value}), page, room.motor)
                    holder.extend(
                        [pages.index(room.motor.lease.operator) if room.motor.lease.operator else -1]
                        * (len(room.loop.commands) - len(holder))
                    )
                done += 1
                if done % 50 == 0:
                    await asyncio.sleep(0)
                for each in pages:
                    each._texts.clear()

        await asyncio.gather(press(0, list(rng.random(5000))), press(1, list(rng.random(5000))))

        assert done == 10_000
        commands = room.loop.commands
        from_whom = [
            int(command.signal.value) if isinstance(command.signal, Constant) else None
            for command in commands
        ]
        assert len(holder) == len(commands) > 3000
        assert {0, 1} <= set(from_whom)
        assert [k for k, who in enumerate(from_whom) if who is not None and who != holder[k]] == []
        # Between two commands of one page and those of the other there is always a release, which is zero volts.
        last = None
        for command, who in zip(commands, from_whom, strict=True):
            if command.enabled is False:
                last = None
            elif who is not None:
                assert last in (None, who)
                last = who

    played(tmp_path, story)


@pytest.mark.parametrize("role", ["operator", "viewer"])
def test_anybody_stops(tmp_path: Path, role: str) -> None:
    async def story(room: Room) -> None:
        one, other = await room.page(), await room.page(role)
        await room.say(one, do="lease")
        await room.say(one, do="start")
        assert room.loop.enabled

        assert (await room.say(other, do="stop"))["ok"]

        assert not room.loop.enabled
        assert [message["kind"] for message in await heard(one)].count("stopped") == 1

    played(tmp_path, story)


def test_a_stop_has_the_number_that_the_loop_acknowledges(tmp_path: Path) -> None:
    async def story(room: Room) -> None:
        one = await room.page()
        await room.say(one, do="lease")
        await room.say(one, do="start")
        answer = await room.say(one, do="stop")
        await room.let_news_come()
        words = [message for message in await heard(one) if message["kind"] == "applied"]
        assert [(word["number"], word["what"]["enabled"]) for word in words] == [
            (1, True),
            (answer["number"], False),
        ]

    played(tmp_path, story)


def test_why_the_motor_stands_is_reported_to_who_comes_later_until_it_is_started(tmp_path: Path) -> None:
    async def story(room: Room) -> None:
        one = await room.page()
        await room.say(one, do="lease")
        await room.say(one, do="start")
        room.motor.leave(one)
        two = await room.page()
        assert "page is gone" in room.motor.state_for(two)["stopped"]
        await room.say(two, do="lease")
        await room.say(two, do="start")
        assert room.motor.state_for(two)["stopped"] == ""

    played(tmp_path, story)


def test_pages_hear_something_though_nothing_happens(tmp_path: Path) -> None:
    async def story(room: Room) -> None:
        one = await room.page()
        signs = asyncio.create_task(room.motor._show_signs())
        assert [message["kind"] for message in await heard(one)] == ["beat"]
        assert [message["kind"] for message in await heard(one)] == ["beat"]  # and again
        signs.cancel()

    played(tmp_path, story)


def test_rows_tell_that_it_goes_on_and_where_they_end_something_else_does() -> None:
    async def story() -> None:
        viewers, one = Viewers(), Viewer("operator")
        viewers.add(one)
        viewers.show_news("", True)
        viewers.heartbeat()
        assert await heard(one) == []  # the rows woke it, and are all there is
        viewers.heartbeat()
        assert [message["kind"] for message in await heard(one)] == ["beat"]

    asyncio.run(asyncio.wait_for(story(), 60))


def test_a_limit_of_the_device_before_is_not_reported_of_the_next_one(tmp_path: Path) -> None:
    async def story(room: Room) -> None:
        one = await room.page()
        room.motor._standing.limited, room.motor._standing.limited_until = (
            True,
            100.0,
        )  # its clock was at 99.5 s
        assert room.motor.state_for(one)["limits"]
        await room.motor.open(room.motor.experiment)
        room.loop.tick()  # its clock begins at 0
        await room.let_news_come()
        assert room.motor.state_for(one)["limits"] == []

    played(tmp_path, story)


def test_the_light_of_the_limits_goes_on_and_off_with_the_rows_though_nothing_else_changes(
    tmp_path: Path,
) -> None:
    async def story(room: Room) -> None:
        one = await room.page()
        room.loop.tick(saturated=True)
        await room.let_news_come()
        assert [each["code"] for each in state_of(await heard(one))["limits"]] == ["saturated"]
        for _ in range(round(0.6 / room.motor.experiment.sample_time)):  # the light stays on for 0.5 s
            room.loop.tick()
        await room.let_news_come()
        assert state_of(await heard(one))["limits"] == []

    played(tmp_path, story)


def test_the_motor_is_at_zero_volts_as_soon_as_the_operators_page_is_gone(tmp_path: Path) -> None:
    async def story(room: Room) -> None:
        one, other = await room.page(), await room.page()
        await room.say(one, do="lease")
        await room.say(one, do="start")

        room.motor.leave(other)
        assert room.loop.enabled

        room.motor.leave(one)
        assert not room.loop.enabled  # at once: before anything else could happen

    played(tmp_path, story)


def test_the_loop_hears_that_somebody_is_there_while_it_is_so_or_it_rests(tmp_path: Path) -> None:
    async def story(room: Room) -> None:
        one = await room.page()
        assert room.motor._may_go_on  # nobody is there, but it rests
        await room.say(one, do="lease")
        await room.say(one, do="start")
        assert room.motor._may_go_on
        room.motor.leave(one)
        # Zero volts were asked for, but not acknowledged yet: where that never happens, the loop ends by itself.
        assert not room.motor._may_go_on
        await room.let_news_come()
        assert room.motor._may_go_on

    played(tmp_path, story)


def test_what_was_set_shows_once_the_loop_says_that_it_is_in_force(tmp_path: Path) -> None:
    async def story(room: Room) -> None:
        page = await room.page()
        await room.say(page, do="lease")
        answer = await room.say(
            page, do="set", chain="derivative | lowpass 80 rad/s", signal={"type": "sine"}
        )
        assert room.motor.experiment.chain == "derivative | lowpass 50 rad/s"

        await room.let_news_come()

        messages = await heard(page)
        applied = [message for message in messages if message["kind"] == "applied"]
        assert [(each["number"], each["accepted"]) for each in applied] == [(answer["number"], True)]
        state = messages[-1]
        assert state["chain"] == "derivative | lowpass 80 rad/s"
        assert state["signal"]["type"] == "sine"

    played(tmp_path, story)


def test_start_begins_the_signal_that_was_asked_for_last_though_the_loop_has_not_answered_yet(
    tmp_path: Path,
) -> None:
    async def story(room: Room) -> None:
        page = await room.page()
        await room.say(page, do="lease")
        await room.say(page, do="set", signal={"type": "sine"})
        await room.say(page, do="start")

        assert room.loop.commands[-1].enabled
        assert isinstance(room.loop.commands[-1].signal, Sine)

    played(tmp_path, story)


def test_what_the_loop_refuses_stays_as_it_was(tmp_path: Path) -> None:
    async def story(room: Room) -> None:
        room.loop.say("command", number=9, accepted=False, what={"signal": {"type": "sine"}}, why="it can't")
        await room.let_news_come()

        assert room.motor.experiment.signal == Experiment().signal

    played(tmp_path, story)


@pytest.mark.parametrize(
    ("said", "named"),
    [
        ({"do": "set", "signal": {"type": "sqare"}}, "square"),
        ({"do": "set", "signal": {"type": "square", "low": "nan"}}, "low"),
        ({"do": "set", "chain": "lowpas 50 rad/s"}, "lowpass"),
        ({"do": "set", "chain": "derivative | derivative"}, "derivative"),
        ({"do": "set"}, "signal"),
        ({"do": "set", "speed": 3}, "speed"),
        ({"do": "fly"}, "known"),
        ({"do": 3}, "known"),
        ({"do": ["set"]}, "known"),
        ({"do": "record", "duration": -1}, "-1"),
        ({"do": "record", "duration": True}, "True"),
        ({"do": "record", "name": "../x"}, "name"),
        ({"do": "record", "name": {"a": 1}}, "name"),
        ({"do": "end_record"}, "recorded"),
        ({"do": "open", "device": {"name": "twi"}}, "twin"),
        ({"do": "open", "device": "twin"}, "device"),
        ({"do": "open", "sample_time": 0}, "sample_time"),
        ({"do": "open", "device": {"name": "twin", "settings": {"resistance": -1}}}, "resistance"),
    ],
)
def test_a_mistake_is_answered_with_a_sentence(tmp_path: Path, said: dict[str, Any], named: str) -> None:
    async def story(room: Room) -> None:
        page = await room.page()
        await room.say(page, do="lease")
        commands = len(room.loop.commands)

        answer = await room.say(page, **said)

        assert not answer["ok"]
        assert named in answer["error"]
        assert len(room.loop.commands) == commands

    played(tmp_path, story)


@pytest.mark.parametrize(
    "text", ["", "[]", "{", '{"do":"set","x":NaN}', '{"do":1e999}', "[" * 60000, '{"a":' * 9000]
)
def test_nonsense_is_answered_and_does_nothing(tmp_path: Path, text: str) -> None:
    async def story(room: Room) -> None:
        page = await room.page()
        await _answer(text, page, room.motor)
        (answer,) = [message for message in await heard(page) if message["kind"] == "answer"]
        assert not answer["ok"]
        assert answer["id"] is None
        assert room.loop.commands == []

    played(tmp_path, story)


def test_another_device_takes_the_place_of_the_one_before(tmp_path: Path) -> None:
    async def story(room: Room) -> None:
        page = await room.page()
        await room.say(page, do="lease")
        first = room.loop
        assert (await room.say(page, do="open", sample_time=0.001))["ok"]

        assert first.left
        assert room.loop is not first
        assert room.loop.experiment.sample_time == 0.001
        assert room.loop.experiment.device.settings["timing"] == "host"
        assert not room.motor._standing.enabled

    played(tmp_path, story)


def state_of(messages: list[dict[str, Any]]) -> dict[str, Any]:
    """The newest state in there; the empty one, of before anything is known, where there is none."""
    return [{"opening": None}, *(message for message in messages if message["kind"] == "state")][-1]


def test_a_device_that_takes_long_to_open_says_so_and_takes_no_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second step compiles kernels the first time: meanwhile the loop, which is there already, hears that somebody is."""
    may_go_on = threading.Event()

    def slowly(*given: Any) -> Any:
        assert may_go_on.wait(60)
        return unidentified(*given)

    async def story(room: Room) -> None:
        page = await room.page()
        await room.say(page, do="lease")
        monkeypatch.setattr(room.motor, "_live_of", slowly)
        await room.motor.begin()  # opens it anew, and shows that somebody is there from now on
        while (told := state_of(await heard(page))["opening"] or {"step": 0})["step"] != 2:
            pass
        assert (told["device"], told["of"]) == ("twin", 2)
        assert told["doing"] == "preparing live identification"
        for asked in ("start", "record", "halt"):
            assert "being opened" in (await room.say(page, do=asked))["error"]
        before = room.loop.signs
        while room.loop.signs < before + 3:
            await asyncio.sleep(0.01)

        may_go_on.set()
        while not (state := state_of(await heard(page))).get("running"):
            pass
        assert state["opening"] is None
        assert (await room.say(page, do="start"))["ok"]

    played(tmp_path, story)


def test_a_device_that_cannot_be_followed_is_closed_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*given: Any) -> Any:
        raise UsageError("there are no counts")

    async def story(room: Room) -> None:
        page = await room.page()
        await room.say(page, do="lease")
        monkeypatch.setattr(room.motor, "_live_of", fails)
        assert (await room.say(page, do="open"))["error"] == "there are no counts"
        assert all(loop.left for loop in room.loops)
        room.motor.show_state()
        state = state_of(await heard(page))
        assert (state["opening"], state["running"]) == (None, False)

    played(tmp_path, story)


def test_a_loop_that_ended_is_reported_and_lets_nothing_be_done_until_another_is_open(tmp_path: Path) -> None:
    async def story(room: Room) -> None:
        page = await room.page()
        await room.say(page, do="lease")
        room.loop.ended = Stopped(reason="device_lost", sentence="the device failed: it was unplugged")
        while room.motor.loop is not None or not room.loop.left:
            await asyncio.sleep(0.01)

        messages = await heard(page)
        assert {"kind": "stopped", "sentence": "the device failed: it was unplugged"} in messages
        assert room.motor.state_for(page)["closed"] == "the device failed: it was unplugged"
        assert "open" in (await room.say(page, do="start"))["error"]
        assert (await room.say(page, do="open"))["ok"]
        assert (await room.say(page, do="start"))["ok"]

    played(tmp_path, story)


def test_ticks_that_were_late_or_missed_are_counted(tmp_path: Path) -> None:
    async def story(room: Room) -> None:
        for k in range(100):
            room.loop.tick(late=k % 10 == 0, skipped=3 if k == 50 else 0)
        await room.let_news_come()
        page = await room.page()

        state = room.motor.state_for(page)

        assert (state["late"], state["missed"]) == (10, 3)

    played(tmp_path, story)


def test_a_page_that_takes_nothing_is_given_up_and_holds_nobody_up(tmp_path: Path) -> None:
    async def story(room: Room) -> None:
        asleep, awake = await room.page(), await room.page()
        for _ in range(2000):
            room.motor.tell({"kind": "library"})
            await heard(awake)

        assert asleep.lost
        assert not awake.lost

    played(tmp_path, story)


def test_without_a_device_there_is_a_sentence(tmp_path: Path) -> None:
    motor = MotorSession(Experiment(), Library(tmp_path))

    with pytest.raises(Refusal, match="open one first"):
        motor.start()
    with pytest.raises(UsageError, match="nothing is being recorded"):
        motor.end_record()


class Ending(LoopDouble):
    """One that can be told to end a recording."""

    def end_recording(self) -> None:
        pass


@pytest.mark.parametrize(
    ("wished", "length", "reasons", "early"),
    [
        (
            10.0,
            9.998,
            [],
            "",
        ),  # a sample time less than was asked for lies between the first row and the last
        (10.0, 9.998, [BY_HAND], ""),  # pressed when it was whole
        (10.0, 4.2, [BY_HAND], BY_HAND),
        (10.0, 4.2, ["the device failed", BY_HAND], "the device failed"),
        (None, 4.2, [BY_HAND], ""),  # as it was meant
        (None, 4.2, ["the device failed"], "the device failed"),
    ],
)
def test_a_recording_that_is_shorter_than_asked_for_says_why(
    tmp_path: Path, wished: float | None, length: float, reasons: list[str], early: str
) -> None:
    with Ending(Experiment()) as loop:
        taking = Capture(loop, Experiment(), tmp_path / "mine", wished)
        for reason in reasons:
            taking.end(reason)
        taking._length = length
        assert taking.outcome() == {"name": "mine", "length": length, "duration": wished, "early": early}


@pytest.mark.parametrize("how", ["fault", "release", "leave", "ended"])
def test_a_recording_ends_with_what_stops_the_motor(tmp_path: Path, how: str) -> None:
    async def story(room: Room) -> None:
        page, other = await room.page(), await room.page()
        await room.say(page, do="lease")
        await room.say(page, do="start")
        taking = Capture(room.loop, Experiment(), tmp_path / "mine", 10.0)
        room.motor.takings.now = taking
        await room.say(page, do="halt")  # the motor coasts, which may be what is to be seen
        await room.say(other, do="stop")  # and how it comes to rest shows that it was stopped
        assert taking.outcome()["early"] == ""

        if how == "fault":
            room.loop.say("fault", code="stall", sentence="the shaft stood")
        elif how == "release":
            await room.say(page, do="release")
        elif how == "leave":
            room.motor.leave(page)
        else:
            room.loop.ended = Stopped(reason="fault", sentence="the shaft stood")
        while not taking.outcome()["early"]:
            await asyncio.sleep(0.005)

        wanted = {"release": "released", "leave": "page is gone"}
        assert wanted.get(how, "the shaft stood") in taking.outcome()["early"]
        room.motor.takings.now = None

    played(tmp_path, story)


def test_the_loop_has_signs_of_life_while_the_identification_is_started(tmp_path: Path) -> None:
    """Its kernels may take long to be compiled: a loop that hears nothing for a second ends itself."""
    loops: list[LoopDouble] = []
    begun, going_on = threading.Event(), threading.Event()

    def loop_of(experiment: Experiment) -> LoopDouble:
        loops.append(LoopDouble(experiment))
        return loops[-1]

    def slow(*_: object) -> None:
        begun.set()
        assert going_on.wait(60)

    async def all_of_it() -> None:
        motor = MotorSession(Experiment(), Library(tmp_path), loop_of, slow)
        await motor.begin()
        assert await asyncio.to_thread(begun.wait, 60)
        before = loops[0].signs
        while loops[0].signs < before + 3:
            await asyncio.sleep(0.01)
        going_on.set()
        await motor.close()

    asyncio.run(asyncio.wait_for(all_of_it(), 60))


def test_a_loop_whose_identification_cannot_be_started_is_closed(tmp_path: Path) -> None:
    loops: list[LoopDouble] = []

    def loop_of(experiment: Experiment) -> LoopDouble:
        loops.append(LoopDouble(experiment))
        return loops[-1]

    def failing(*_: object) -> None:
        raise StorageError("no memory for a ring")

    async def all_of_it() -> None:
        motor = MotorSession(Experiment(), Library(tmp_path), loop_of, failing)
        with pytest.raises(StorageError):
            await motor.open(motor.experiment)
        assert motor.loop is None
        await motor.close()

    asyncio.run(all_of_it())
    assert loops[0].left


@pytest.mark.promise("S42")
def test_what_the_loop_warns_of_is_reported_to_every_page_once(tmp_path: Path) -> None:
    async def story(room: Room) -> None:
        page = await room.page("viewer")
        room.loop.warnings = ("NO ANSWER FROM THE DEVICE FOR 0.8 S TO A READ; SWITCH OFF THE SUPPLY",)
        for _ in range(2):
            room.motor._tell_warnings()
        told = [message for message in await heard(page) if message["kind"] == "fault"]
        assert [(each["code"], each["sentence"]) for each in told] == [("switch-off", *room.loop.warnings)]

    played(tmp_path, story)


def test_a_recording_counts_from_its_first_row_though_its_recorder_has_not_begun(tmp_path: Path) -> None:
    with Ending(Experiment()) as loop:
        loop.tick()
        taking = Capture(loop, Experiment(), tmp_path / "mine", 0.2)
        lengths = []
        for _ in range(3):
            for _ in range(75):
                loop.tick()
            lengths.append(taking.state()["length"])
        assert taking.state()["samples"] == 0  # nothing is in the file yet

    sample_time = Experiment().sample_time
    assert lengths == pytest.approx([min(rows * sample_time, 0.2) for rows in (75, 150, 225)])


def test_a_recording_that_is_ended_counts_no_more(tmp_path: Path) -> None:
    with Ending(Experiment()) as loop:
        taking = Capture(loop, Experiment(), tmp_path / "mine", None)
        for _ in range(10):
            loop.tick()
        taking.end(BY_HAND)
        loop.tick()
        assert taking.state()["length"] == pytest.approx(10 * Experiment().sample_time)


@pytest.mark.parametrize(
    ("danger", "zero_volts", "word"),
    [
        ("", True, "the motor is at rest"),
        ("", False, "the motor was not driven"),
        ("NO ANSWER; SWITCH OFF THE SUPPLY", False, "NO ANSWER; SWITCH OFF THE SUPPLY"),
        ("NO ANSWER; SWITCH OFF THE SUPPLY", True, "NO ANSWER; SWITCH OFF THE SUPPLY"),
    ],
)
def test_the_last_word_is_what_the_loop_knows_of_the_motor(
    tmp_path: Path, danger: str, zero_volts: bool, word: str
) -> None:
    async def story(room: Room) -> None:
        room.loop.danger, room.loop.zero_volts = danger, zero_volts

    assert played(tmp_path, story).motor.last_word == word


def test_another_device_at_rest_says_nothing_of_one_that_never_answered(tmp_path: Path) -> None:
    other = Experiment().model_copy(
        update={"device": Experiment().device.model_copy(update={"settings": {"inertia": "3e-5 kg·m²"}})}
    )

    async def story(room: Room) -> None:
        room.loop.danger = "NO ANSWER"
        await room.motor.open(other)
        assert room.motor.danger == "NO ANSWER"
        await room.motor.open(Experiment())  # the one that didn't answer; it is closed at zero volts

    assert played(tmp_path, story).motor.last_word == "the motor is at rest"


def test_the_loop_is_ended_before_anything_that_may_take_its_time(tmp_path: Path) -> None:
    async def story(room: Room) -> None:
        await room.motor._changing.acquire()  # a device is being opened, and that takes for ever
        closing = asyncio.create_task(room.motor.close())
        while not room.loop.rested:
            await asyncio.sleep(0.005)
        assert not closing.done()
        room.motor._changing.release()
        await closing
        with pytest.raises(Refusal, match="the panel is closing"):
            await room.motor.open(Experiment())

    played(tmp_path, story)
