"""Help and version come at once, and say what the commands themselves would say."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from servobench._version import __version__
from servobench.cli import main
from servobench.cli.failures import INTERRUPTED
from tests.cli.conftest import Command

ROOT = Path(__file__).resolve().parent.parent.parent
HEAVY = ("numba", "scipy", "matplotlib", "numpy", "pydantic", "typer", "rich", "h5py")


def write_help() -> ModuleType:
    spec = importlib.util.spec_from_file_location("write_help", ROOT / "tools" / "write_help.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_stored_help_is_what_the_commands_say_of_themselves() -> None:
    tool = write_help()

    stored = {path.name: path.read_text(encoding="ascii") for path in tool.FOLDER.glob("*.txt")}

    assert stored == tool.pages(), "run make generate"


def test_writing_the_help_removes_the_page_of_a_command_that_is_gone(tmp_path: Path) -> None:
    (tmp_path / "servobench-gone.txt").write_text("gone")

    tool = write_help()
    tool.write(tmp_path)

    assert {path.name for path in tmp_path.iterdir()} == set(tool.pages())


def test_no_line_of_help_is_wider_than_a_terminal() -> None:
    lines = [line for text in write_help().pages().values() for line in text.splitlines()]

    assert max(map(len, lines)) <= 80


@pytest.mark.parametrize(
    "words",
    [["--version"], ["--help"], ["-h"], ["identify", "--help"], ["run", "-h"], ["lab", "do", "-h"]],
    ids=" ".join,
)
def test_help_and_version_import_nothing_heavy(words: list[str]) -> None:
    script = (
        f"import sys\nfrom servobench.cli import main\nstatus = main({words!r})\n"
        f"print(status, sorted(set({HEAVY!r}) & set(sys.modules)))"
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)

    assert ended.stdout.splitlines()[-1] == "0 []"
    assert ended.stderr == ""


def test_the_version_is_that_of_the_package(servobench: Command) -> None:
    assert servobench("--version").out == f"servobench {__version__}\n"


def test_help_in_the_middle_of_a_line_is_help_on_that_command(servobench: Command) -> None:
    ended = servobench("identify", "data.csv", "--help")

    assert ended.status == 0
    assert ended.out.startswith("Usage: servobench identify ")


@pytest.mark.parametrize("word", ["../app", "servobench", "RUN", "run.txt", ""])
def test_only_a_command_has_a_page_of_help(servobench: Command, word: str) -> None:
    ended = servobench(word, "--help")

    assert ended.status == 2
    assert "No such command" in ended.err


def test_no_words_at_all_get_the_help(servobench: Command) -> None:
    assert servobench() == servobench("--help")


def test_main_takes_the_words_of_the_process_where_none_are_given(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["servobench", "--version"])

    assert main() == 0
    assert capsys.readouterr().out == f"servobench {__version__}\n"


def test_ctrl_c_while_the_commands_are_imported_is_one_sentence() -> None:
    script = (
        "import sys\n"
        "class Interrupting:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == 'typer':\n"
        "            raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Interrupting())\n"
        "from servobench.cli import main\n"
        "sys.exit(main(['signals']))"
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)

    assert ended.returncode == INTERRUPTED
    assert ended.stdout == ""
    assert ended.stderr == "Error: interrupted before anything was done\n"


@pytest.mark.parametrize("said", [None, "2"])
def test_a_command_computes_with_one_thread_unless_the_environment_says_otherwise(said: str | None) -> None:
    """Fits have narrow matrices, whose threads wait for each other longer than they compute."""
    script = (
        "import os, sys\nfrom servobench.cli import main\nsys.argv[1:] = ['--version']\nmain()\n"
        "print(os.environ['OMP_NUM_THREADS'])"
    )
    environment = {name: value for name, value in os.environ.items() if name != "OMP_NUM_THREADS"}
    given = {} if said is None else {"OMP_NUM_THREADS": said}
    ended = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=True,
        env={**environment, **given},
    )

    assert ended.stdout.splitlines()[-1] == (said or "1")


def test_a_program_that_calls_the_command_line_keeps_its_own_settings() -> None:
    script = (
        "import gc, os\nos.environ.pop('OMP_NUM_THREADS', None)\nbefore = gc.get_threshold()\n"
        "from servobench.cli import main\nmain(['--version'])\n"
        "print(gc.get_threshold() == before, gc.get_freeze_count(), os.environ.get('OMP_NUM_THREADS'))"
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)

    assert ended.stdout.splitlines()[-1] == "True 0 None"


def test_reading_a_table_of_somebody_elses_imports_no_models_of_experiments() -> None:
    """They cost a tenth of a short command."""
    script = (
        "import sys\nfrom servobench.rig.lateness import lateness\n"
        "print('servobench.rig.experiment' in sys.modules, 'pydantic' in sys.modules)"
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)

    assert ended.stdout.splitlines()[-1] == "False False"


def test_identifying_imports_no_library_that_it_does_without(finished_run: Path) -> None:
    path = finished_run / "recording.mcap"
    heavy = ("matplotlib", "pandas", "scipy.linalg", "scipy.optimize", "scipy.signal", "scipy.stats")
    script = (
        f"import sys\nfrom servobench.cli import main\nstatus = main(['identify', {str(path)!r}])\n"
        f"print(status, sorted(set({heavy!r}) & set(sys.modules)))"
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)

    # Numba's own linear algebra asks for scipy.linalg: kernels do without sum(), mean() and max() of arrays.
    assert ended.stdout.splitlines()[-1] == "0 []"
