"""Work on recordings, which takes seconds, in a process of its own at low priority: neither loop nor page waits for it."""

from __future__ import annotations

import asyncio
import json
import logging
import os
import re
import subprocess
import sys
from collections.abc import Awaitable, Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from typing import IO, Any, Protocol, TypeAlias, cast

import servobench.core.errors as errors
from servobench.core.errors import ServobenchError, UsageError
from servobench.panel.low_priority import FLAGS, give_way, surroundings
from servobench.rig.loop.exit_status import exit_text

Said: TypeAlias = Callable[[str], None]


class Work(Protocol):
    """Has a piece of work done: `do_elsewhere` does."""

    def __call__(self, asked: Mapping[str, Any], said: Said = ..., /) -> Awaitable[dict[str, Any]]:
        """Do the work; `said` is called with the current step."""
        ...


STARTING, READING, IDENTIFYING, WRITING = STAGES = (
    "starting",
    "reading the recording",
    "identifying",
    "writing the report",
)

COMPILING = "compiling equations for their first use"
"""Part of the stages, once per installation for each model; its length isn't known beforehand."""

PATIENCE = 300.0  # s; then it's ended
_AT_ONCE = asyncio.Semaphore(1)
_LONGEST = 16 * 1024 * 1024  # bytes of an answer
_DOING = b"doing: "


def nobody_asks(doing: str) -> None:
    """Take no notice of what is done now."""


async def do_elsewhere(order: Mapping[str, Any], said: Said = nobody_asks) -> dict[str, Any]:
    """Have a piece of work done, one at a time, and return what came out; raises the error that it raised there.

    `asked` is JSON, whose `do` says which: see `PIECES`. What is wrong with its `file` is told by the name `called`. `said` is
    told what is done now. Cancelled, it ends the process.
    Raises `UsageError` also for a piece that took too long, or ended without an answer.
    """
    async with _AT_ONCE:
        said(STARTING)
        hand_on = partial(_to_loop, asyncio.get_running_loop(), said)
        process = await _start_process()
        talking = asyncio.create_task(asyncio.to_thread(_conversation, process, order, hand_on))
        try:
            async with asyncio.timeout(PATIENCE):
                answer = await asyncio.shield(talking)
        except TimeoutError:
            raise UsageError(
                f"this took longer than {PATIENCE:g} s and was ended; use a shorter recording"
            ) from None
        finally:
            process.kill()  # nothing happens where it has ended
            await asyncio.wait([talking])
    if "error" in answer:
        raise error_called(answer["error"], answer["sentence"])
    return answer


def error_called(name: str, sentence: str) -> ServobenchError:
    """Return an error that was raised elsewhere, as the class that it had, or as the message for any other error."""
    kind = getattr(errors, name, UsageError)
    simple = kind in (UsageError, errors.FormatError, errors.StorageError, errors.NotIdentifiable)
    error: ServobenchError = (kind if simple else UsageError)(sentence)
    return error


async def _start_process() -> subprocess.Popen[bytes]:
    """Start the process in another thread: on a busy machine it takes long until it is one of its own."""
    starting = asyncio.create_task(asyncio.to_thread(_process))
    try:
        return await asyncio.shield(starting)
    except asyncio.CancelledError:
        process = await starting
        process.kill()
        await asyncio.to_thread(process.communicate)
        raise


def _process() -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "servobench.panel.work"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=surroundings(),
        creationflags=FLAGS,
    )


def _conversation(process: subprocess.Popen[bytes], order: Mapping[str, Any], said: Said) -> dict[str, Any]:
    """Ask, hand on what is said of the work meanwhile, and return the answer; raises `UsageError` where none came."""
    with process, ThreadPoolExecutor(1) as reader:
        stdin, stdout, stderr = (
            cast("IO[bytes]", end) for end in (process.stdin, process.stdout, process.stderr)
        )
        complaints = reader.submit(stderr.read)
        with suppress(OSError):  # it is gone already, and its complaints say why
            stdin.write(json.dumps(order).encode())
            stdin.close()
        last = b""
        while line := stdout.readline(_LONGEST):
            last = line
            if line.startswith(_DOING):
                said(line.removeprefix(_DOING).decode().strip())
        process.wait()
        try:
            answer: dict[str, Any] = json.loads(last)
        except ValueError:  # it was ended before it could say anything, by a lack of memory for instance
            word = (
                complaints.result().decode("utf-8", "replace").strip().splitlines() or ["without a word"]
            )[-1]
            raise UsageError(
                f"the process that did this ended {exit_text(process.returncode)}: {word[:200]}"
            ) from None
    return answer


def _to_loop(server: asyncio.AbstractEventLoop, said: Said, doing: str) -> None:
    """Hand on to the server's thread what is said in another one."""
    with suppress(RuntimeError):  # the server has ended
        server.call_soon_threadsafe(said, doing)


def _say(doing: str) -> None:
    """Say in the process that does the work what is done now."""
    sys.stdout.write(f"{_DOING.decode()}{doing}\n")
    sys.stdout.flush()


@contextmanager
def _stage(doing: str) -> Iterator[None]:
    """Say what is done meanwhile, and when kernels are compiled for it, which takes far longer than itself."""
    from servobench.core.compiled import announce_compilations

    def note_compiling(before: int) -> None:
        _say(f"{COMPILING} ({before} done)")

    _say(doing)
    with announce_compilations(note_compiling, lambda: _say(doing)):
        yield


def identify_file(order: Mapping[str, Any]) -> dict[str, Any]:
    """Identify the recording `file` with the model `structure`, and write the page `report`; return the result.

    It is what `servobench identify FILE` makes of it.
    """
    from pathlib import Path

    from servobench.identification.identify import identify
    from servobench.panel.columns import apply_mapping
    from servobench.recordings.measurement.measure import measure
    from servobench.recordings.native.reader import read
    from servobench.report.document import Report

    with _stage(READING):
        recording = apply_mapping(read(order["file"])[0], Path(order["file"]).parent)
        data = measure(recording)  # the counts: the scopes' filter is for the eye
    with _stage(IDENTIFYING):
        result = identify([data], structure=order["structure"])
    with _stage(WRITING):
        command = f"servobench identify {os.path.basename(order['file'])}"
        Report([recording], result, command=command).write(order["report"])
    return {"result": result.to_dict()}


def import_file(order: Mapping[str, Any]) -> dict[str, Any]:
    """Read the file `file` of any format, and write its recording to the native file `to`; return what is asked about it.

    Raises `UsageError` for a file that doesn't hold one recording.
    """
    from dataclasses import asdict, replace
    from pathlib import Path

    from servobench.panel.capture import about
    from servobench.panel.columns import questions
    from servobench.recordings.formats.base import save
    from servobench.recordings.loading.load import load

    recordings = load(order["file"])
    if len(recordings) != 1:
        raise UsageError(f"the file holds {len(recordings)} recordings; upload a file with one")
    source = replace(recordings[0].source, name=order["name"])
    save(replace(recordings[0], source=source), order["to"])
    about_it = asdict(about(Path(order["to"]), order["created"], ""))
    return {"about": about_it, "questions": questions(recordings[0])}


def preview_mapping(order: Mapping[str, Any]) -> dict[str, Any]:
    """Look at the recording `file` as the answers `said` want it; return the mapping that they are, and what comes of it.

    That is its length [s] and how many samples of the output there are. Raises `UsageError` for fewer than two, and what
    `mapping_of` and `assign` raise.
    """
    from servobench.panel.columns import mapping_of
    from servobench.recordings.native.reader import read

    mapping = mapping_of(order["said"])
    recording = mapping.assign_to(read(order["file"])[0])
    series = recording[recording.output or ""]
    t = series.t
    if t is None or len(t) < 2:
        raise UsageError("fewer than two samples have a time and a value there; choose other columns")
    return {"mapping": mapping.toml(), "length": float(t[-1] - t[0]), "samples": len(t)}


def convert_file(order: Mapping[str, Any]) -> dict[str, Any]:
    """Write the recording in the native file `file` to the file `to`, in the format that its ending says."""
    from servobench.recordings.formats.base import save
    from servobench.recordings.native.reader import read

    save(read(order["file"]), order["to"])
    return {}


def exercise_results(order: Mapping[str, Any]) -> dict[str, Any]:
    """Do the exercise `name` of the folder `folder` on the simulated motor; return what its studies find and what it corrects."""
    from pathlib import Path

    from servobench.lab.exercise_content import results
    from servobench.lab.exercise_file import exercise
    from servobench.lab.stand import stand_on_the_twin
    from servobench.lab.worked_exercise import WorkedExercise

    definition = exercise(order["name"], Path(order["folder"]))
    return results(WorkedExercise(exercise=definition, stand=stand_on_the_twin(definition), given={}))


def exercise_facts(order: Mapping[str, Any]) -> dict[str, Any]:
    """Find the facts `names` of the exercise `name` of the folder `folder` on the simulated motor.

    Of each that there is return value and half-width, or what keeps it from being told; `known` are the names of all.
    """
    from pathlib import Path

    from servobench.lab.exercise_file import exercise
    from servobench.lab.stand import stand_on_the_twin

    facts = stand_on_the_twin(exercise(order["name"], Path(order["folder"]))).facts
    values: dict[str, list[float]] = {}
    untold: dict[str, list[str]] = {}
    for name in order["names"]:
        try:
            if name in facts:
                values[name] = [facts[name].value, facts[name].half]
        except ServobenchError as error:
            untold[name] = [type(error).__name__, str(error)]
    return {"found": values, "untold": untold, "known": list(facts)}


PIECES: dict[str, Callable[[Mapping[str, Any]], dict[str, Any]]] = {
    "identify": identify_file,
    "import": import_file,
    "map": preview_mapping,
    "convert": convert_file,
    "exercise": exercise_results,
    "facts": exercise_facts,
}


def _with_name(order: Mapping[str, Any], sentence: str) -> str:
    """A message on the requested file with the name that the user knows: `called`, if that is another one."""
    if "called" not in order:
        return sentence
    file = str(order["file"])
    ours = re.compile(f"{re.escape(file)}|(?<![^\\s'\"`]){re.escape(os.path.basename(file))}")
    return ours.sub(lambda _: str(order["called"]), sentence)


def main() -> int:
    """Do what standard input asks for, and say on standard output what came out."""
    logging.disable(logging.WARNING)  # the program that started this one gives the same ones
    give_way()
    order = json.loads(sys.stdin.buffer.read())
    try:
        answer = PIECES[order["do"]](order)
    except ServobenchError as error:
        answer = {"error": type(error).__name__, "sentence": _with_name(order, str(error))}
    except MemoryError:
        answer = {
            "error": "UsageError",
            "sentence": "there isn't enough memory for this; use a shorter recording",
        }
    except RecursionError:
        answer = {"error": "FormatError", "sentence": "the file's content is nested too deeply"}
    sys.stdout.write(json.dumps(answer, allow_nan=False))
    sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
