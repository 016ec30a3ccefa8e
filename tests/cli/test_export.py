"""`servobench export`, as a user types it."""

import json
from pathlib import Path

from tests.cli.conftest import Command


def test_a_run_is_exported_and_nothing_is_overwritten(
    servobench: Command, finished_run: Path, tmp_path: Path
) -> None:
    file = tmp_path / "motor.csv"

    assert servobench("export", finished_run, "--as", "csv", "--out", file).status == 0
    assert file.read_text(encoding="utf-8").startswith(
        "parameter,value,sd,low,high,level,unit,verdict\ngain,23."
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
    assert "would be lost" in ended.err


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
