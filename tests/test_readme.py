"""The README is true: its commands and its Python run, and do what it says."""

from __future__ import annotations

import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

from servobench.rig.loop.schedule import HOW_TO_PERMIT
from tests import forks

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", README, flags=re.DOTALL | re.MULTILINE)


def commands() -> list[tuple[str, str]]:
    """The shell commands and what the comment behind each says."""
    lines = [line for block in blocks("sh") for line in block.splitlines() if line.strip()]
    return [(line.partition(" #")[0].strip(), line.partition(" #")[2].strip()) for line in lines]


def indented(how_to: str, word: str) -> list[str]:
    """The lines of the one indented block with this word in a guide: what no command of the guide prints."""
    page = (ROOT / "docs" / "how-to" / f"{how_to}.md").read_text(encoding="utf-8")
    (block,) = [found for found in re.findall(r"(?:^    .+\n)+", page, re.MULTILINE) if word in found]
    return [line.strip() for line in block.splitlines()]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as a user has it: the examples, a recording with a speed, and one without times or names."""
    import servobench as sb

    folder = tmp_path_factory.mktemp("readme")
    shutil.copytree(ROOT / "examples", folder / "examples")
    with sb.connect("twin") as motor:
        run = sb.run(sb.Experiment(signal=sb.Square(low=1, high=3, frequency=0.4), duration=5), motor)
    t, u = run["applied"].t, run["applied"].values
    angle = np.degrees(run["counts"].values * 2 * np.pi / 2048)
    speed = np.gradient(angle, t)
    np.savetxt(folder / "recording.csv", np.c_[t, u, speed], delimiter=",", header="t,u,y", comments="")
    np.savetxt(folder / "no_times.csv", np.c_[u, angle], delimiter=",")
    return folder


def test_there_are_commands_to_try() -> None:
    assert len(commands()) >= 10
    assert len(blocks("python")) == 1


@pytest.mark.parametrize(("command", "comment"), commands())
def test_a_command_of_the_readme_runs(command: str, comment: str, folder: Path) -> None:
    words = shlex.split(command)
    expected = int(found[1]) if (found := re.search(r"exit status (\d+)", comment)) else 0
    if words[0] == "make":  # what it would do; the real thing is what calls this test
        words, where = ["make", "-n", *words[1:]], ROOT
    elif words[:2] == ["python", "-m"]:
        target = folder / "site"
        words = [
            sys.executable,
            *words[1:-1],
            "--quiet",
            "--no-deps",
            "--no-build-isolation",
            "--target",
            str(target),
            ".",
        ]
        where = ROOT
    else:
        assert words[0] == "servobench"
        words, where = ["-m", *words], folder
    if words[0] == "-m":
        done = forks.run(words, cwd=where)
    else:
        done = subprocess.run(words, cwd=where, capture_output=True, text=True, check=False)
    if "real_time" in command and done.returncode != expected:
        # A computer that doesn't keep up, as one that runs other tests beside this one, ends such a run, and says so.
        expected = 4
        assert re.search(r"were\s+missed\s+at|no\s+new\s+voltage\s+came", done.stdout)
    assert done.returncode == expected, done.stdout + done.stderr
    if expected == 2:
        assert "--sample-time" in done.stderr


def test_the_readme_is_short() -> None:
    assert len(README.split()) <= 900


def test_what_the_guide_permits_is_what_the_loop_asks_for() -> None:
    permits = indented("experiment", "rtprio")

    assert len(permits) == 2
    assert all(f"`{line}`" in HOW_TO_PERMIT for line in permits)


def test_the_python_of_the_readme_runs(folder: Path) -> None:
    code = blocks("python")[0]
    done = forks.run(["-c", code], cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "gain" in done.stdout
    assert "trusted" in done.stdout
    assert (folder / "report.html").stat().st_size > 10_000


def test_the_figures_of_the_readme_are_those_of_the_demo(folder: Path) -> None:
    """The table that the README shows is what a run prints, digit for digit."""
    wide = {**os.environ, "COLUMNS": "100"}
    done = forks.run(["-m", "servobench", "run", "--out", "demo"], cwd=folder, env=wide)
    shown = [line.split() for line in blocks("text")[0].splitlines() if line.strip()]
    printed = [line.split() for line in done.stdout.splitlines()]
    missing = [" ".join(row) for row in shown if row not in printed]
    assert not missing, done.stdout


def test_the_file_that_the_readme_identifies_is_the_one_that_the_tool_makes() -> None:
    spec = importlib.util.spec_from_file_location("write_example", ROOT / "tools" / "write_example.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)

    assert module.FILE.read_text(encoding="utf-8") == module.table(), "run make generate"


def identified(words: list[str], folder: Path) -> list[list[str]]:
    done = forks.run(
        ["-m", "servobench", "identify", *words], cwd=folder, env={**os.environ, "COLUMNS": "90"}
    )
    assert done.returncode == 0, done.stderr
    return [line.split() for line in done.stdout.splitlines()]


def test_the_figures_of_the_logger_are_those_that_it_prints(folder: Path) -> None:
    (shown,) = [block for block in blocks("text") if "36.1322" in block]

    printed = identified(["examples/logger.csv", "--output", "angle:deg"], folder)

    assert all(line.split() in printed for line in shown.splitlines())


def is_alike(shown: str, printed: str) -> bool:
    """Whether two words are the same, or figures that differ by one in the last place: processors add up in different orders."""
    if not re.fullmatch(r"-?[\d.]+", shown):
        return shown == printed
    last = Decimal(1).scaleb(int(Decimal(shown).as_tuple().exponent))
    return abs(Decimal(shown) - Decimal(printed)) <= last


def test_the_figures_of_the_motor_that_is_not_ours_are_those_that_it_prints(
    folder: Path, real_data: Callable[[str], Path]
) -> None:
    shown = indented("csv", "0.434")
    file = real_data("undcmotor/und_DCmotor_prbs_open_exp.csv")

    printed = identified([str(file), "--output", "y:deg/s"], folder)

    for line in shown:
        row = next(row for row in printed if row[:1] == line.split()[:1])
        assert all(is_alike(*words) for words in zip(line.split(), row, strict=True)), row
    assert sum(line[:1] == ["!"] for line in printed) == 0


def test_no_figure_of_a_long_benchmark_stands_in_the_readme() -> None:
    """Nobody makes them anew with each change, so that they are of an older version; the benchmarks' pages are dated."""
    prose = re.sub(r"(?s)```.*?```", "", README)

    assert not [line for line in prose.splitlines() if line.lstrip().startswith("| ")]
    assert not re.findall(r"\d %", prose.replace("95 %", ""))
    for page in ("accuracy", "peers"):
        dated = (ROOT / "docs" / "benchmarks" / f"{page}.md").read_text(encoding="utf-8")
        assert f"(docs/benchmarks/{page}.md)" in README
        assert re.search(r"on 20\d\d-\d\d-\d\d", dated)
        assert "servobench 0." in dated


def test_what_a_reference_needs_is_that_of_the_package() -> None:
    from servobench._version import __version__

    cited = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {__version__}\n" in cited
    assert "\nlicense: BSD-3-Clause\n" in cited
