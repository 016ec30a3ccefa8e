"""Programs run in forks of a process that has imported everything: what isn't about starting up needn't start up each time.

A fork is a process of its own, with its own folder, environment, arguments, output and exit status; what it changes ends with it.
It has what was imported and compiled when its parent was started, so a plug-in that is installed later needs an interpreter.
Run as a program, this is that parent: it takes orders line by line.
"""

from __future__ import annotations

import atexit
import functools
import gc
import json
import os
import runpy
import signal
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

ROOT = Path(__file__).resolve().parent.parent


@functools.cache
def _parent() -> subprocess.Popen[str]:
    """The process that forks; it ends when its input does, that is with these tests."""
    return subprocess.Popen(
        [sys.executable, "-m", "tests.forks"],
        cwd=ROOT,
        env={**os.environ, "MPLBACKEND": "agg"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def run(
    words: Sequence[str], *, cwd: Path, env: Mapping[str, str] | None = None, timeout: int = 300
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
        order = [list(words), str(cwd), environment, timeout, str(out), str(err)]
        parent = _parent()
        assert parent.stdin is not None
        assert parent.stdout is not None
        parent.stdin.write(f"{json.dumps(order)}\n")
        parent.stdin.flush()
        status = json.loads(parent.stdout.readline())
        texts = [path.read_text(encoding="utf-8") for path in (out, err)]
    return subprocess.CompletedProcess(list(words), status, *texts)


def _serve() -> None:
    """Carry out orders until there are no more."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what libraries print while they are warmed up is no answer
    _warm_up()
    gc.freeze()  # a collection in a fork would copy what the parent holds, and go through it
    gc.set_threshold(20_000, 20, 20)  # as in the tests themselves
    for line in sys.stdin:
        words, cwd, environment, timeout, out, err = json.loads(line)
        child = os.fork()
        if not child:
            answers.close()
            _become(words, cwd, environment, out, err)
        signal.signal(signal.SIGALRM, lambda *_, child=child: os.kill(child, signal.SIGKILL))
        signal.alarm(timeout)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        signal.alarm(0)
        answers.write(f"{status}\n")
        answers.flush()


def _warm_up() -> None:
    """Import what commands need, and load the kernels, by a run of the simulated motor, an identification and the exercises."""
    from servobench.cli import main

    with tempfile.TemporaryDirectory() as folder:
        main(["run", "--out", f"{folder}/run"])
        main(["identify", f"{folder}/run/recording.mcap"])
        main(["lab", "list"])


def _become(words: list[str], cwd: str, environment: dict[str, str], out: str, err: str) -> NoReturn:
    """Be the program, and end as an interpreter does, but for taking apart what there is in memory: that takes a second."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
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
