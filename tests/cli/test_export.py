"""`servobench export`, as a user types it."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.cli.conftest import Command


def test_a_run_is_exported_and_nothing_is_overwritten(
    servobench: Command, finished_run: Path, tmp_path: Path
) -> None:
    file = tmp_path / "motor.csv"

    assert servobench("export", finished_run, "--as", "csv", "--out", file).status == 0
    assert file.read_text(encoding="utf-8").startswith(
        "parameter,value,sd,low,high,level,unit,state,verdict\ngain,23."
    )
    again = servobench("export", finished_run, "--as", "csv", "--out", file)
    assert again.status == 2
    assert "--overwrite" in again.err
    assert servobench("export", finished_run, "--as", "csv", "--out", file, "--overwrite").status == 0


def test_the_result_itself_is_never_the_target(
    servobench: Command, finished_run: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "motor.json"
    copy.write_bytes((finished_run / "result.json").read_bytes())

    ended = servobench("export", copy, "--as", "json", "--out", copy, "--overwrite")

    assert ended.status == 2
    assert "would be overwritten" in ended.err


def test_a_refused_result_exports_nothing(servobench: Command, tmp_path: Path) -> None:
    refused = tmp_path / "result.json"
    refused.write_text(json.dumps({"schema": "servobench.result/1", "verdict": "refused", "findings": []}))

    ended = servobench("export", refused, "--as", "json", "--out", tmp_path / "out.json")

    assert ended.status == 3
    assert "it contains no model" in ended.err
    assert not (tmp_path / "out.json").exists()


def test_units_at_the_edges(servobench: Command, finished_run: Path, tmp_path: Path) -> None:
    file = tmp_path / "motor.xml"
    words = ("export", finished_run, "--as", "mujoco", "--out", file)

    assert servobench(*words, "--inertia", "210 g*cm^2").status == 0
    assert 'armature="2.1e-05"' in file.read_text(encoding="utf-8")
    assert servobench(*words, "--inertia", "3 s", "--overwrite").status == 2


def test_an_unknown_target_is_named(servobench: Command, finished_run: Path) -> None:
    ended = servobench("export", finished_run, "--as", "matlb")

    assert ended.status == 2
    assert "did you mean 'matlab'" in ended.err


def test_what_tune_prints_becomes_c_that_runs(
    servobench: Command, finished_run: Path, tmp_path: Path
) -> None:
    compiler = shutil.which("cc") or shutil.which("gcc")
    assert compiler is not None, "no C compiler (cc) on the path"
    file, source = tmp_path / "tuning.json", tmp_path / "loop.c"
    for words in (("--damping", "0.8", "--bandwidth", "20"), ("--loop", "speed", "--lambda", "0.1")):
        file.write_text(servobench("tune", finished_run, *words, "--json").out, encoding="utf-8")

        ended = servobench(
            "export", file, "--as", "c", "--controller-counts-per-rev", 2048, "--out", source, "--overwrite"
        )

        assert ended.status == 0, ended.err
        command = [compiler, "-std=c99", "-DLOOP_SELF_TEST", "loop.c", "-lm", "-o", "loop"]
        subprocess.run(command, cwd=tmp_path, check=True, timeout=120)
        assert subprocess.run([str(tmp_path / "loop")], timeout=60, capture_output=True).returncode == 0


def test_a_tuned_controller_takes_its_counts_and_nothing_else(
    servobench: Command, finished_run: Path, tmp_path: Path
) -> None:
    file = tmp_path / "tuning.json"
    tune = ("tune", finished_run, "--damping", "0.8", "--bandwidth", "20", "--json")
    file.write_text(servobench(*tune).out, encoding="utf-8")

    without = servobench("export", file, "--as", "c", "--out", tmp_path / "a.c")
    java = servobench("export", file, "--as", "java", "--out", tmp_path / "A.java")
    more = ("--controller-counts-per-rev", 2048, "--controller-sample-time", "1ms", "--out", tmp_path / "b.c")
    again = servobench("export", file, "--as", "c", *more)

    assert (without.status, java.status, again.status) == (2, 2, 2)
    assert "--controller-counts-per-rev" in without.err
    assert "which is exported as c" in java.err
    assert "`servobench tune`" in again.err


def test_robot_code_shows_its_constants_with_their_intervals(
    servobench: Command, finished_run: Path, tmp_path: Path
) -> None:
    out = tmp_path / "Drive.java"

    ended = servobench(
        "export", finished_run, "--as", "java", "--unit", "m", "--wheel-diameter", "6in", "--out", out
    )

    assert ended.status == 0
    # kV = 1/K at a rim of 3 in: 1/(23.7 · 0.0762) V·s/m
    line = next(line for line in ended.out.splitlines() if line.strip().startswith("kV"))
    assert float(line.split()[1]) == pytest.approx(1 / (23.7 * 0.0762), rel=0.02)
    assert " to " in line
    assert "public final class Drive {" in out.read_text(encoding="ascii")
    wrong = servobench("export", finished_run, "--as", "java", "--unit", "m", "--out", tmp_path / "No.java")
    assert wrong.status == 2
    assert "--wheel-diameter" in wrong.err


def test_a_second_file_of_a_target_replaces_nothing_in_silence(
    servobench: Command, finished_run: Path, tmp_path: Path
) -> None:
    """MATLAB's target writes a .mat file beside the .m file that is named."""
    there = tmp_path / "motor.mat"
    there.write_text("somebody's recording")
    words = ("export", finished_run, "--as", "matlab", "--out", tmp_path / "motor.m")

    refused = servobench(*words)

    assert refused.status == 2
    assert "motor.mat exists already" in refused.err
    assert there.read_text() == "somebody's recording"
    assert not (tmp_path / "motor.m").exists()
    assert servobench(*words, "--overwrite").status == 0


def test_a_wheel_without_a_unit_is_asked_for_it(servobench: Command, finished_run: Path) -> None:
    ended = servobench("export", finished_run, "--as", "java", "--wheel-diameter", "6")

    assert ended.status == 2
    assert "such as 6in" in ended.err
