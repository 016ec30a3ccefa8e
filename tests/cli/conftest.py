"""The tests' ways to run the command line: in this process, or as a user does."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from servobench.cli import main
from tests import forks


@dataclass(frozen=True)
class Ended:
    """The end of a command, and its output."""

    status: int
    out: str
    err: str

    @property
    def result(self) -> dict[str, Any]:
        """The result on standard output, which holds nothing else; checked against the packaged schema."""
        return checked(json.loads(self.out))


def checked(result: dict[str, Any]) -> dict[str, Any]:
    """Return a result that the packaged schema allows."""
    _validator().validate(result)
    return result


@cache
def _validator() -> jsonschema.Draft202012Validator:
    schema = json.loads(
        files("servobench").joinpath("identification/schemas/result-2.json").read_text(encoding="utf-8")
    )
    return jsonschema.Draft202012Validator(
        schema, format_checker=jsonschema.Draft202012Validator.FORMAT_CHECKER
    )


Command = Callable[..., Ended]


@pytest.fixture
def servobench(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Command:
    """Return a function that runs a command line in this process."""
    monkeypatch.setenv("COLUMNS", "100")

    def command(*words: object) -> Ended:
        capsys.readouterr()
        status = main([str(word) for word in words])
        said = capsys.readouterr()
        return Ended(status, said.out, said.err)

    return command


def environment(**changed: str) -> dict[str, str]:
    """Return the environment of a command, with nothing in it that would colour its words."""
    kept = {name: value for name, value in os.environ.items() if name not in {"FORCE_COLOR", "NO_COLOR"}}
    return {**kept, "PYTHONIOENCODING": "utf-8", "COLUMNS": "100", **changed}


def process(*words: object, **changed: str) -> Ended:
    """Run a command line as a process of its own, with some environment variables changed."""
    ended = subprocess.run(
        [sys.executable, "-m", "servobench", *map(str, words)],
        env=environment(**changed),
        capture_output=True,
        timeout=300,
    )
    encoding = changed.get("PYTHONIOENCODING", "utf-8")
    return Ended(ended.returncode, ended.stdout.decode(encoding), ended.stderr.decode(encoding))


def in_a_fork(*words: object) -> Ended:
    """Run a command line as a process of its own that needn't import anything."""
    ended = forks.run(["-m", "servobench", *map(str, words)], cwd=Path.cwd(), env=environment())
    return Ended(ended.returncode, ended.stdout, ended.stderr)


@contextmanager
def started(*words: object) -> Iterator[subprocess.Popen[str]]:
    """Start a command line as a process of its own, which is gone in the end, whatever happens."""
    child = subprocess.Popen(
        [sys.executable, "-m", "servobench", *map(str, words)],
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        # On Windows a request to end goes to a whole group of processes, and must not reach this one.
        creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
    )
    try:
        yield child
    finally:
        child.kill()
        child.communicate()


@pytest.fixture(scope="session")
def finished_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a run of the paper's experiment; tests only read in it."""
    folder = tmp_path_factory.mktemp("finished") / "run"
    ended = in_a_fork("run", "--out", folder)
    assert ended.status == 0, ended.err
    return folder
