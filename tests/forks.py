"""Programs run in forks of a process that has imported everything: what isn't about starting up needn't start up each time.

A fork is a process of its own, with its own folder, environment, arguments, output and exit status; what it changes ends with it.
It has what was imported and compiled when its parent was started, so a plug-in that is installed later needs an interpreter.
Several may run at a time, each asked for by a thread. Run as a program, this is that parent: it takes orders line by line.
"""

from __future__ import annotations

import atexit
import gc
import json
import math
import os
import runpy
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

ROOT = Path(__file__).resolve().parent.parent


class _Parent:
    """The process that forks, seen by whoever gives orders; it is started with the first one, and ends with these tests."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._process: subprocess.Popen[str] | None = None
        self._orders = 0
        self._statuses: dict[int, int] = {}
        self._somebody_reads = False

    def carry_out(self, order: list[Any]) -> int:
        """Give an order, and return the exit status of the fork that it is about."""
        with self._changed:
            process = self._process = self._process or self._start()
            self._orders += 1
            number = self._orders
            assert process.stdin is not None
            process.stdin.write(f"{json.dumps([number, *order])}\n")
            process.stdin.flush()
            while number not in self._statuses:
                if self._somebody_reads:
                    self._changed.wait()
                else:
                    self._read(process)
            return self._statuses.pop(number)

    def _read(self, process: subprocess.Popen[str]) -> None:
        """Wait for one fork's end, whoever wants to know it, and let the others look whether it was theirs."""
        self._somebody_reads = True
        self._changed.release()
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
        finally:
            self._changed.acquire()
            self._somebody_reads = False
            self._changed.notify_all()
        number, status = json.loads(line)
        self._statuses[number] = status

    def _start(self) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-m", "tests.forks"],
            cwd=ROOT,
            env={**os.environ, "MPLBACKEND": "agg"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )


_parent = _Parent()


def run(
    words: Sequence[str], *, cwd: Path, env: Mapping[str, str] | None = None, timeout: float = 300
) -> subprocess.CompletedProcess[str]:
    """Run what follows `python` in a command line, `-m MODULE`, `-c TEXT` or a file; after `timeout` seconds it is killed.

    Where processes can't fork an interpreter is started.
    """
    environment = dict(os.environ if env is None else env)
    if not hasattr(os, "fork"):
        command = [sys.executable, *words]
        return subprocess.run(
            command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=timeout
        )
    with tempfile.TemporaryDirectory() as folder:
        out, err = Path(folder) / "out", Path(folder) / "err"
        status = _parent.carry_out([list(words), str(cwd), environment, timeout, str(out), str(err)])
        texts = [path.read_text(encoding="utf-8") for path in (out, err)]
    return subprocess.CompletedProcess(list(words), status, *texts)


def _serve() -> None:
    """Carry out orders until there are no more."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what libraries print while they are warmed up is no answer
    _warm_up()
    gc.freeze()  # a collection in a fork would copy what the parent holds, and go through it
    gc.set_threshold(20_000, 20, 20)  # as in the tests themselves
    wake, woken = os.pipe()
    os.set_blocking(wake, False)
    os.set_blocking(woken, False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(woken)
    latest: dict[int, tuple[int, float]] = {}  # of each fork the number of its order, and when it is killed
    rest = b""
    while True:
        until = min((moment for _, moment in latest.values()), default=math.inf) - time.monotonic()
        ready = select.select([0, wake], [], [], None if math.isinf(until) else max(0.0, until))[0]
        if wake in ready:
            os.read(wake, 4096)
        for child, (number, moment) in list(latest.items()):
            if time.monotonic() >= moment:
                os.kill(child, signal.SIGKILL)
            ended, status = os.waitpid(child, 0 if time.monotonic() >= moment else os.WNOHANG)
            if ended:
                del latest[child]
                answers.write(f"{json.dumps([number, os.waitstatus_to_exitcode(status)])}\n")
                answers.flush()
        if 0 not in ready:
            continue
        data = os.read(0, 2**20)
        if not data:
            break
        *lines, rest = (rest + data).split(b"\n")
        for line in lines:
            number, words, cwd, environment, timeout, out, err = json.loads(line)
            child = os.fork()
            if not child:
                signal.set_wakeup_fd(-1)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                for each in (wake, woken):
                    os.close(each)
                answers.close()
                _become(words, cwd, environment, out, err)
            latest[child] = number, time.monotonic() + timeout


def _warm_up() -> None:
    """Import what commands need, and load the kernels, by a run of the simulated motor, an identification and the exercises."""
    from servobench.cli import main

    with tempfile.TemporaryDirectory() as folder:
        main(["run", "--out", f"{folder}/run"])
        main(["identify", f"{folder}/run/recording.mcap"])
        main(["lab", "list"])


def _become(words: list[str], cwd: str, environment: dict[str, str], out: str, err: str) -> NoReturn:
    """Be the program, and end as an interpreter does, but for taking apart what there is in memory: that takes a second."""
    for number, name in ((0, os.devnull), (1, out), (2, err)):
        file = os.open(name, os.O_RDWR | os.O_CREAT)
        os.dup2(file, number)
        os.close(file)
    for number, stream in enumerate(("stdin", "stdout", "stderr")):
        opened: Any = os.fdopen(number, "w" if number else "r", encoding="utf-8", closefd=False)
        setattr(sys, stream, opened)
        setattr(sys, f"__{stream}__", opened)
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(environment)
    sys.path[:0] = [path for path in environment.get("PYTHONPATH", "").split(os.pathsep) if path]
    status = 0
    try:
        _carry_out(words)
    except SystemExit as end:
        if isinstance(end.code, str):
            sys.stderr.write(f"{end.code}\n")
        status = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
        status = 1
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def _carry_out(words: list[str]) -> None:
    kind, *arguments = words
    if kind == "-m":
        sys.argv = arguments
        runpy.run_module(arguments[0], run_name="__main__", alter_sys=True)
    elif kind == "-c":
        sys.argv = ["-c", *arguments[1:]]
        sys.path.insert(0, "")
        exec(compile(arguments[0], "<string>", "exec"), {"__name__": "__main__"})
    else:
        sys.argv = words
        sys.path.insert(0, str(Path(kind).resolve().parent))
        runpy.run_path(kind, run_name="__main__")


if __name__ == "__main__":
    _serve()
