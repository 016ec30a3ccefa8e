"""Builds the firmware, the simulated rig around it and the parts that run on this computer; all from Debian's packages."""

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
FIRMWARE = ROOT / "firmware"
HERE = Path(__file__).resolve().parent
PACKAGES = "gcc-avr avr-libc binutils-avr libsimavr-dev libelf-dev"
PURE = ("control", "encoder_check", "frames", "stall", "states", "table")
"""The firmware's files that touch no register."""


def needed() -> None:
    """Skip the test that calls it where the packages aren't there."""
    there = shutil.which("avr-gcc") and shutil.which("make") and shutil.which("gcc")
    if not (sys.platform == "linux" and there and Path("/usr/include/simavr/sim_avr.h").is_file()):
        pytest.skip(f"simavr is absent: install {PACKAGES}")


def _digest(files: Sequence[Path]) -> str:
    found = hashlib.sha256()
    for file in sorted(files):
        found.update(file.name.encode() + file.read_bytes())
    return found.hexdigest()[:16]


@cache
def _folder() -> Path:
    """The folder for the builds of these very sources."""
    sources = [*FIRMWARE.glob("*.[ch]"), FIRMWARE / "Makefile", *HERE.glob("*.c")]
    folder = ROOT / "build" / "rig" / _digest(sources)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _once(name: str, build: Sequence[str], output: str) -> Path:
    """Build a file unless it's there; whole or not at all, as two tests may want it at a time."""
    file = _folder() / name
    if not file.is_file():
        with tempfile.TemporaryDirectory(dir=_folder()) as own:
            words = [word.replace("@", own) for word in build]
            done = subprocess.run(words, capture_output=True, text=True, cwd=HERE)
            assert done.returncode == 0, done.stderr
            os.replace(Path(own) / output, file)
    return file


@cache
def firmware(name: str = "rig-500000") -> Path:
    """Return the firmware that `make firmware` builds: rig-500000, rig-115200; or rig-test, which can be hung."""
    needed()
    return _once(f"{name}.elf", ["make", "-C", str(FIRMWARE), "OUT=@", f"@/{name}.elf"], f"{name}.elf")


@cache
def library() -> Path:
    """Return the simulated rig as a shared library."""
    needed()
    words = "gcc -O2 -Wall -Wextra -Werror -shared -fPIC simrig.c -o @/simrig.so -lsimavr -lm -lelf"
    return _once("simrig.so", words.split(), "simrig.so")


@cache
def program() -> Path:
    """Return the simulated rig as a program at a pseudo-terminal."""
    needed()
    words = "gcc -O2 -Wall -Wextra -Werror -DPROGRAM simrig.c -o @/simrig -lsimavr -lm -lelf -lutil"
    return _once("simrig", words.split(), "simrig")


@cache
def pure() -> Path:
    """Return the firmware's files that touch no register as a shared library for this computer."""
    needed()
    sources = [str(FIRMWARE / f"{name}.c") for name in PURE]
    words = [
        "gcc",
        "-O2",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-shared",
        "-fPIC",
        f"-I{FIRMWARE}",
        *sources,
        "pure.c",
    ]
    return _once("pure.so", [*words, "-o", "@/pure.so"], "pure.so")
