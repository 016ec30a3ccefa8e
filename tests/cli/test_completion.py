"""`servobench completion`: scripts that hold the commands, options and names that there are."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
import typer.main

from servobench.cli.app import app
from servobench.systems.signals.base import SIGNALS
from tests.cli.conftest import Command

ASK = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMPREPLY=()
_servobench
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.fixture
def script(servobench: Command, tmp_path: Path) -> Path:
    """The script for bash, in a file."""
    file = tmp_path / "completion.bash"
    file.write_text(servobench("completion", "bash").out, encoding="utf-8")
    return file


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash here")
@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        (["ident"], {"identify"}),
        (["identify", "--str"], {"--structure"}),
        (["identify", "x.csv", "--estimator", "out"], {"output_error"}),
        (["signals", "squ"], {"square"}),
        (["export", "run", "--as", "ma"], {"matlab"}),
        (["tune", "run", "--as", "le"], {"lead"}),
        (["lab", "do", "--fol"], {"--folder"}),
        (["run", "--nominal", "qube_servo_2"], {"qube_servo_2"}),
    ],
    ids=lambda value: " ".join(value),
)
def test_bash_offers_what_there_is(script: Path, typed: list[str], offered: set[str]) -> None:
    ended = subprocess.run(
        ["bash", "-c", ASK, "ask", str(script), "servobench", *typed],
        capture_output=True,
        text=True,
        check=True,
        cwd=script.parent,
    )

    assert set(ended.stdout.split()) == offered


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish", "powershell"])
def test_every_script_holds_all_commands_and_the_names_of_signals(servobench: Command, shell: str) -> None:
    said = servobench("completion", shell).out
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]

    for word in (*commands, *SIGNALS.names(), "sample-time"):
        assert re.search(rf"(?<![\w-])(--)?{word}(?![\w-])", said), word


def test_another_shell_is_reported(servobench: Command) -> None:
    ended = servobench("completion", "tcsh")

    assert ended.status == 2
    assert "no shell called 'tcsh'; known: bash, fish, powershell, zsh" in ended.err
