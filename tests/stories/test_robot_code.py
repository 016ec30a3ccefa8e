"""The stories of people who program what drives a motor: SysId's file to constants in Java, a tuned loop to C."""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
from pathlib import Path

from tests.recordings.formats.robots import constants_of, sysid_json
from tests.rig.motor.reference import Truth
from tests.stories.scripts import run_command


def test_a_file_of_sysid_becomes_constants_in_java(tmp_path: Path, python: Path) -> None:
    (tmp_path / "drive.json").write_text(sysid_json())

    printed = run_command(
        tmp_path, python, "export", "drive.json", "--as", "java", "--out", "DriveConstants.java"
    )

    true, text = constants_of(Truth()), (tmp_path / "DriveConstants.java").read_text()
    for name, value in (("kS", true.ks), ("kV", true.kv), ("kA", true.ka)):
        (line,) = re.findall(rf"{name} = (\S+); // .*95 %: (\S+) to (\S+)\n", text)
        stated, low, high = map(float, line)
        # Three sd of a 95 % interval are 1.53 of its halves; beyond that the winding, 0.14 ms of 99 ms, and four digits.
        assert abs(stated - value) <= 1.53 * 0.5 * (high - low) + 2e-3 * value
        assert name in printed


def test_a_tuned_loop_becomes_c_that_a_compiler_takes_and_that_passes_its_test(
    tmp_path: Path, python: Path
) -> None:
    compiler = shutil.which("cc") or shutil.which("gcc")
    assert compiler is not None, "no C compiler (cc) on the path"
    run_command(tmp_path, python, "run", "--out", "motor")
    tuning = run_command(
        tmp_path,
        python,
        "tune",
        "motor",
        "--damping",
        "0.8",
        "--bandwidth",
        "8",
        "--voltage-limit",
        "10",
        "--json",
    )
    (tmp_path / "tuning.json").write_text(tuning)

    run_command(
        tmp_path,
        python,
        "export",
        "tuning.json",
        "--as",
        "c",
        "--out",
        "loop.c",
        "--controller-counts-per-rev",
        "2048",
    )

    strict = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror"]
    test = re.search(r"-D\s*(\w*TEST\w*)", (tmp_path / "loop.c").read_text())
    assert test is not None
    build = [compiler, *strict, f"-D{test[1]}", "loop.c", "-lm", "-o", "loop"]
    subprocess.run(build, cwd=tmp_path, check=True, timeout=120)
    assert subprocess.run([tmp_path / "loop"], timeout=60, check=False).returncode == 0
    assert math.isfinite(json.loads(tuning)["controller"]["kp"])
