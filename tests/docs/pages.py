"""The examples of a page, in the order in which somebody follows them: files to write, commands to type, Python to run."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests import forks

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
FENCE = re.compile(r"^```(?P<language>[^\n]*)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)
FILE = re.compile(r"`(?P<name>[\w./-]+\.\w+)`[^`]*:\s*\Z")
RUN = {"sh", "python"}
SHOWN = {"text", "toml", "markdown", "json", "c"}
LONGEST = 300  # seconds for one command; the first may compile


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its text, its line, and the file that the sentence before it says it is."""

    language: str
    text: str
    line: int
    file: str | None


def blocks(page: Path) -> Iterator[Block]:
    """Yield the fenced blocks of a page, those of Sphinx (`{toctree}`) left out."""
    text = page.read_text(encoding="utf-8")
    for match in FENCE.finditer(text):
        before = text[: match.start()]
        if not match["language"].startswith("{"):
            named = FILE.search(before)
            line = before.count("\n") + 1
            yield Block(match["language"], match["text"], line, named["name"] if named else None)


def commands(block: Block) -> Iterator[tuple[str, str]]:
    """Yield the commands of a block, each with its comment."""
    for line in block.text.splitlines():
        command, _, comment = line.partition(" #")
        if command.strip() and not command.lstrip().startswith("#"):
            yield command.strip(), comment.strip()


class Reader:
    """Somebody who follows a page from top to bottom, in a folder of their own with the project's examples in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.printed = ""
        shutil.copytree(ROOT / "examples", folder / "examples")
        paths = [str(folder / "site"), os.environ.get("PYTHONPATH", "")]
        self.environment = {
            **os.environ,
            "COLUMNS": "80",
            "PYTHONPATH": os.pathsep.join(path for path in paths if path),
            "MPLBACKEND": "agg",
        }

    def follow(self, page: Path) -> int:
        """Do all that the page says; returns how many things were run. Fails with the line of what didn't work."""
        done = 0
        for block in blocks(page):
            where = f"{page.name}:{block.line}"
            if block.file is not None:
                path = self.folder / block.file
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(block.text, encoding="utf-8")
            elif block.language == "sh":
                for command, comment in commands(block):
                    self.type(command, comment, where)
                    done += 1
            elif block.language == "python":
                self.run([sys.executable, "-c", block.text], 0, where)
                done += 1
            elif block.language == "text":
                self.compare(block.text, where)
        return done

    def compare_cells(self, notebook: Path, outputs: Sequence[str]) -> None:
        """Hold what a notebook shows against what its cells printed, one after the other."""
        printed = iter(outputs)
        for cell in blocks(notebook):
            if cell.language == "python":
                self.printed = next(printed)
            elif cell.language == "text":
                self.compare(cell.text, f"{notebook.name}:{cell.line}")

    def type(self, command: str, comment: str, where: str) -> None:
        """Run a command; its comment may say the exit status, or that Ctrl-C ends it."""
        words = shlex.split(command)
        if "Ctrl-C" in comment:
            return self.begin_and_interrupt(self.ours(words, where), where)
        expected = int(found[1]) if (found := re.search(r"exit status (\d+)", comment)) else 0
        if words[:4] == ["python", "-m", "pip", "install"]:
            return self.install(words[4:], where)
        return self.run(self.ours(words, where), expected, where)

    def ours(self, words: list[str], where: str) -> list[str]:
        """The command as this interpreter runs it."""
        assert words[0] in {"servobench", "python"}, f"{where}: no test knows how to run {words[0]}"
        return [sys.executable, *(["-m"] if words[0] == "servobench" else []), *words[words[0] == "python" :]]

    def install(self, what: list[str], where: str) -> None:
        """Install into a folder of the reader's; nothing is fetched, and extras are those of the project."""
        own = (self.folder / "pyproject.toml").exists()
        assert [word.partition("[")[0] for word in what] == ["."], f"{where}: installs {what}"
        extra = re.search(r"\[(\w+)\]", what[0])
        project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
        assert extra is None or f"\n{extra[1]} = [" in project, f"{where}: no extra {extra}"
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation"]
        # The project itself is imported from where these tests found it, with the kernels that are compiled there.
        source, target = (self.folder, "site") if own else (ROOT, "unused")
        self.run([*pip, "--target", str(self.folder / target), str(source)], 0, where)

    def run(self, words: list[str], expected: int, where: str) -> None:
        if "pip" in words or (self.folder / "site").exists():  # what a fork came too early for
            done = subprocess.run(
                words, cwd=self.folder, env=self.environment, capture_output=True, text=True, timeout=LONGEST
            )  # fmt: skip
        else:
            done = forks.run(words[1:], cwd=self.folder, env=self.environment, timeout=LONGEST)
        self.printed = done.stdout + done.stderr
        assert done.returncode == expected, f"{where}: {' '.join(words)}\n{self.printed}"

    def begin_and_interrupt(self, words: list[str], where: str) -> None:
        """Run what goes on until it is interrupted, and interrupt it once it has printed its address."""
        words = [*words, "--no-open", "--port", "0"] if "panel" in words else words
        process = subprocess.Popen(
            words, cwd=self.folder, env=self.environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )  # fmt: skip
        try:
            self.printed, latest = "", time.monotonic() + LONGEST
            assert process.stdout is not None
            while "http://" not in self.printed:
                line = process.stdout.readline()
                assert line, f"{where}: it ended by itself: {self.printed}"
                assert time.monotonic() < latest, f"{where}: no address in {LONGEST} s"
                self.printed += line
            process.send_signal(signal.SIGINT)
            self.printed += process.communicate(timeout=LONGEST)[0]
        finally:
            process.kill()
            process.wait()
        assert process.returncode in (0, 130), f"{where}: {self.printed}"

    def compare(self, shown: str, where: str) -> None:
        """Hold lines that a page shows against those that the command before printed, word for word."""
        printed = [line.split() for line in self.printed.splitlines()]
        missing = [line for line in shown.splitlines() if line.strip() and line.split() not in printed]
        assert not missing, f"{where}: not printed: {missing}\n{self.printed}"
