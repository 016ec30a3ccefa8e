"""`servobench watch`: identify a motor that another program drives, while it runs."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from datetime import datetime
from functools import partial
from pathlib import Path
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Annotated, Self

import typer

from servobench.cli.options import (
    AS_IT_IS,
    AllFindings,
    AsJson,
    DataSheet,
    Reading,
    StartsAtRest,
    StructureName,
    Until,
    with_reading,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

    from servobench.identification.result import Result
    from servobench.identification.watch import Watch
    from servobench.recordings.evidence import Evidence
    from servobench.recordings.formats.mapping import Mapping as ColumnMapping
    from servobench.recordings.streams.base import Stream

    Judge = Callable[[Sequence[Evidence]], Result | None]

_PATIENCE = 0.2  # s of waiting for rows, before the display is renewed
_BLOCK = 200  # rows between two looks at why to stop, however many come at once
KNOWN = "known"


@with_reading
def watch(
    context: typer.Context,
    source: Annotated[str, typer.Argument(metavar="SOURCE", hidden=True)],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="The folder for recording, result and report; by default a new one named after the time.",
        ),
    ] = None,
    until: Until = None,
    stop_after: Annotated[
        str | None,
        typer.Option("--stop-after", metavar="TIME", help="Stop after this time of the stream, such as 20s."),
    ] = None,
    reading: Reading = AS_IT_IS,
    starts_at_rest: StartsAtRest = False,
    structure: StructureName = "auto",
    nominal: DataSheet = None,
    as_json: AsJson = False,
    all_findings: AllFindings = False,
) -> None:
    """Identify a running motor that something else drives; nothing is sent to it.

    SOURCE is - for standard input, a serial port such as /dev/ttyACM0 or COM3@57600, udp:PORT, a growing text file, or
    networktables:HOST/TOPIC,TOPIC with the position last. Lines hold numbers, such as t,u,counts, with or without a header.

    It shows the parameters as their intervals narrow, and says when enough is known or which motion is missing. Everything is
    recorded. Ctrl-C, the end of the stream, --until or --stop-after end it; then all of it is identified and reported.
    --until known means the gain to 2 % and the time constant to 5 %.
    """
    from servobench.cli.conclusion import check_names, conclude, status_of
    from servobench.cli.output_folder import empty_folder
    from servobench.cli.progress import Progress, announce_compiling
    from servobench.cli.terminal import OutputGone, messages, output, say
    from servobench.core.errors import UsageError
    from servobench.recordings.reading import mapping_of
    from servobench.recordings.streams.base import stream_of

    check_names(structure, "auto", nominal)
    wish, length = _wish(until), _length(stop_after)
    if reading.recording:
        raise UsageError(f"--recording {reading.recording[0]}: a stream is one recording; leave it out")
    mapping = mapping_of(**reading.options)
    stream = stream_of(source)
    console = messages() if as_json else output()
    judge = partial(_judge, structure=structure, starts_at_rest=starts_at_rest)
    with empty_folder(out, "watch", datetime.now()) as folder:
        evidence = _record(stream, mapping, folder, console, wish, length, until is not None, judge)
        with suppress(OutputGone):  # the report is written all the same
            say(console, f"recording: {folder / 'recording.mcap'}\n")
        with Progress() as progress, announce_compiling(progress):
            result = conclude(
                evidence, progress, structure=structure, nominal=nominal, starts_at_rest=starts_at_rest
            )
        _deliver(result, evidence, folder, console, as_json, context.obj or "", all_findings)
    raise typer.Exit(status_of(result))


def _wish(until: str | None) -> Mapping[str, float] | None:
    """The wish for intervals; None for the default."""
    from servobench.identification.design.stopping_rule import parse_wish

    return None if until is None or until.strip() == KNOWN else parse_wish(until)


def _length(text: str | None) -> float | None:
    """The time to watch [s]; raises `UsageError` where it can't be one."""
    from servobench.core.errors import UnitError, UsageError
    from servobench.core.units import quantity

    if text is None:
        return None
    try:
        length = quantity(text, "s")
    except (UnitError, UsageError) as error:
        raise UsageError(f"--stop-after {text}: {error}") from None
    if not 0 < length < float("inf"):
        raise UsageError(f"--stop-after {text}: expected a time above 0, such as 20s")
    return length


def _record(
    stream: Stream,
    mapping: ColumnMapping,
    folder: Path,
    console: Console,
    wish: Mapping[str, float] | None,
    length: float | None,
    until_known: bool,
    judge: Judge,
) -> list[Evidence]:
    """Watch the stream into the folder until it ends, or is to end."""
    from servobench.cli.live_text import LiveText
    from servobench.identification.watch import Watch, stop_text

    watched = Watch(mapping, stream.name, folder / "recording.mcap", wish)
    try:
        with (
            _requests() as requested,
            stream,
            LiveText(console) as text,
            _Judgement(watched, judge) as judged,
        ):

            def show(silence: float) -> None:
                judged.go_on()
                text.show(watched, silence)

            reason = _follow(stream, watched, show, requested, length, until_known)
            evidence = watched.end(stop_text(reason))
            text.show_last(watched)
    except BaseException:
        watched.abandon()
        raise
    return evidence


def _follow(
    stream: Stream,
    watched: Watch,
    show: Callable[[float], None],
    requested: Callable[[], bool],
    length: float | None,
    until_known: bool,
) -> str:
    """Take rows until there is a reason to stop, and return that; a stream that is silent for `length` [s] is over, too."""
    heard = time.monotonic()
    while not requested():
        rows = stream.read(_PATIENCE)
        if rows is None:
            return "end"
        if len(rows.values):
            heard = time.monotonic()
        else:
            watched.look_again()  # no further row will call for it
        silence = time.monotonic() - heard
        blocks = rows.blocks(_BLOCK)
        for block in blocks:
            watched.take(block)
            if length is not None and (watched.duration >= length or silence >= length):
                return "time"
            show(silence)
            if until_known and watched.known:
                return "known"
            if requested():
                break
        for block in blocks:  # where the end was asked for amid them: all that had come is recorded
            watched.take(block)
    last = stream.read(0.0)
    if last is not None:
        watched.take(last)
    return "interrupted"


class _Judgement:
    """Identifies the rows so far, aside, where the live intervals say that it is enough: those hold noise only.

    A context manager; as in `StoppingRule`, each look is at a fifth more than the one before.
    """

    def __init__(self, watched: Watch, judge: Judge) -> None:
        self._watched, self._judge = watched, judge
        self._aside = ThreadPoolExecutor(max_workers=1)
        self._running: Future[Result | None] | None = None
        self._next = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Let the look that is under way end."""
        self._aside.shutdown(cancel_futures=True)

    def go_on(self) -> None:
        """Take the result of a look that has ended, or begin one where it is time."""
        from servobench.identification.design.stopping_rule import GROWTH

        if self._running is not None and self._running.done():
            result, self._running = self._running.result(), None
            if result is not None:
                self._watched.judge(result)
        elif self._running is None and self._watched.enough and self._watched.duration >= self._next:
            self._next = GROWTH * self._watched.duration
            self._running = self._aside.submit(self._look)

    def _look(self) -> Result | None:
        return self._judge(self._watched.so_far())


def _judge(evidence: Sequence[Evidence], structure: str, starts_at_rest: bool) -> Result | None:
    """The result of the rows so far; None where they tell nothing yet."""
    from servobench.core.errors import NotIdentifiable
    from servobench.identification.identify import identify_evidence

    try:
        return identify_evidence(evidence, structure, starts_at_rest=starts_at_rest)
    except NotIdentifiable:
        return None


@contextmanager
def _requests() -> Iterator[Callable[[], bool]]:
    """Let Ctrl-C, and whatever else asks the process to end, be noted: the recording is finished first. A second one ends all."""
    from servobench.rig.loop.requests import requests_here

    noted: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        noted.append(number)
        if len(noted) > 1:
            raise KeyboardInterrupt

    ours = [each for each in requests_here() if signal.getsignal(each) is signal.SIG_DFL]
    before = {each: signal.signal(each, note) for each in (signal.SIGINT, *ours)}
    try:
        yield lambda: bool(noted)
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


def _deliver(
    result: Result,
    evidence: Sequence[Evidence],
    folder: Path,
    console: Console,
    as_json: bool,
    command: str,
    all_findings: bool,
) -> None:
    """Write result and report into the folder, and print the result as `identify` does."""
    from servobench.cli.conclusion import deliver
    from servobench.cli.run_folder import RunFolder
    from servobench.core.rounding import count_text

    recordings = [each.recording for each in evidence]
    rows = sum(len(each.series[0].values) for each in recordings)
    RunFolder(folder).write_result(result.to_dict())
    deliver(
        result,
        recordings,
        console=console,
        as_json=as_json,
        report=folder / "report.html",
        command=command,
        heading=f"{count_text(rows, 'row')}; {recordings[-1].stopped.sentence}",
        all_findings=all_findings,
    )
