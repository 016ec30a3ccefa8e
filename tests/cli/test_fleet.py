"""`servobench fleet`: what is typed, printed, written and returned."""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from servobench.cli import main
from servobench.fleet import identification, page
from servobench.fleet.parts import rows_in
from servobench.fleet.repeatability import gauge_study
from tests.cli.conftest import Command
from tests.cli.test_each import COLUMNS
from tests.fleet.motors import comparable, write_fleet, write_motor

PATTERN = ("--pattern", "{line}/{serial}_{date}.csv")
WORKERS = ("--workers", "1")

pytestmark = pytest.mark.usefixtures("quick_workers")


def valid(text: str, schema: str) -> dict[str, Any]:
    """The one JSON object in a text, held against its schema."""
    document: dict[str, Any] = json.loads(text)
    rules = json.loads(files("servobench").joinpath(f"cli/schemas/{schema}.json").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(rules)
    jsonschema.Draft202012Validator(rules).validate(document)
    return document


@pytest.fixture(autouse=True)
def _few_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    """A report takes longer than ten identifications."""
    monkeypatch.setattr(page, "WORST", 1)


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten motors, of which one has twice the gain."""
    folder = tmp_path_factory.mktemp("stand")
    write_fleet(folder, 9)
    write_motor(folder / "line1" / "0099_2026-11-30.csv", 40.0)
    return folder


@pytest.fixture(scope="module")
def results(stand: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with the results of these motors."""
    out = tmp_path_factory.mktemp("results") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "WORST", 2)
        assert main(["fleet", str(stand), "--out", str(out), *PATTERN, *COLUMNS]) == 0
    return out


def test_a_folder_becomes_a_table_and_a_report(stand: Path, results: Path) -> None:
    import pandas

    table = pandas.read_parquet(results / "motors.parquet").set_index("file")
    with (results / "motors.csv").open(encoding="utf-8-sig", newline="") as file:
        sheet = {row["file"]: row for row in csv.DictReader(file)}
    html = (results / "report.html").read_text(encoding="utf-8")
    odd = "line1/0099_2026-11-30.csv"

    assert len(table) == len(sheet) == 10
    assert table.loc[odd, "gain"] == pytest.approx(40.0, rel=1e-3)
    assert float(sheet[odd]["gain"]) == table.loc[odd, "gain"]
    assert table.index[table["outlier"]].tolist() == [odd]
    assert sheet[odd]["serial"] == "0099"
    links = re.findall(r'<a href="(reports/[^"]+)">([^<]+)</a>', html)
    assert links[0][1] == odd
    assert sorted(results / link for link, _ in links) == sorted((results / "reports").iterdir())
    assert len(links) == 2


def test_limits_decide_and_other_limits_identify_nothing(
    servobench: Command, stand: Path, results: Path, tmp_path: Path
) -> None:
    limits = tmp_path / "limits.toml"
    words = ("fleet", stand, "--out", results, *PATTERN, *COLUMNS, "--limits", limits, "--json")
    before = sorted(path.name for path in (results / "parts").iterdir())
    limits.write_text("[gain]\nlow = 15\nhigh = 30", encoding="utf-8")
    failed = servobench(*words)
    limits.write_text("rule = 'ilac-g8'\n[gain]\nlow = 15\nhigh = '400 rpm/V'", encoding="utf-8")
    passed = servobench(*words)
    limits.write_text("[delay]\nhigh = -1\n[electrical_time_constant]\nhigh = 1", encoding="utf-8")
    failing_and_open = servobench(*words)
    limits.write_text("[electrical_time_constant]\nhigh = 1", encoding="utf-8")
    undecided = servobench(*words)

    assert (failed.status, passed.status, failing_and_open.status, undecided.status) == (6, 0, 6, 7)
    assert valid(failed.out, "fleet-1")["decisions"] == {"pass": 9, "fail": 1}
    assert valid(passed.out, "fleet-1")["rule"] == "ilac-g8"
    assert valid(undecided.out, "fleet-1")["decisions"] == {"undecided": 10}
    assert "0 files done, 10 before" in failed.err
    assert sorted(path.name for path in (results / "parts").iterdir()) == before


@pytest.mark.parametrize(
    ("limits", "because"),
    [
        ("[gain]\nlow = '3 s'", "the limit low of gain: '3 s' is a time"),
        ("[gian]\nlow = 3", "did you mean 'gain'"),
    ],
)
def test_wrong_limits_are_reported(
    limits: str, because: str, servobench: Command, stand: Path, results: Path, tmp_path: Path
) -> None:
    file = tmp_path / "limits.toml"
    file.write_text(limits, encoding="utf-8")
    ended = servobench("fleet", stand, "--out", results, *PATTERN, *COLUMNS, "--limits", file)

    assert ended.status == 2
    assert because in ended.err


def test_other_settings_are_refused_by_the_names_of_options(
    servobench: Command, stand: Path, results: Path
) -> None:
    ended = servobench("fleet", stand, "--out", results, *PATTERN, *COLUMNS, "--starts-at-rest")

    assert ended.status == 2
    assert f"--out {results} holds results of other settings" in ended.err
    assert "starts_at_rest was False and is now True" in ended.err


def test_a_file_without_a_result_is_a_row_and_the_status(servobench: Command, tmp_path: Path) -> None:
    write_fleet(tmp_path / "stand", 1)
    (tmp_path / "stand" / "torn.csv").write_text("voltage,speed\n1,2\n", encoding="utf-8")
    ended = servobench("fleet", tmp_path / "stand", "--out", tmp_path / "out", *COLUMNS, *WORKERS)

    assert ended.status == 2
    assert "2 motors: 1 trusted, 1 unusable" in ended.out
    assert "torn.csv: the times: say --sample-time SECONDS" in ended.out
    assert len(comparable(tmp_path / "out")) == 2


def test_mapping_is_kept_with_the_results(servobench: Command, tmp_path: Path) -> None:
    write_fleet(tmp_path / "stand", 1)
    mapping = tmp_path / "mapping.toml"
    mapping.write_text('output = "speed:rad/s"\nchain = "none"\n', encoding="utf-8")
    words = ("fleet", tmp_path / "stand", "--out", tmp_path / "out", "--mapping", mapping, *WORKERS)
    first = servobench(*words)
    mapping.write_text('output = "speed:deg/s"\nchain = "none"\n', encoding="utf-8")
    second = servobench(*words)

    assert first.status == 0, first.err
    assert second.status == 2
    assert "reading mapping was output" in second.err


def test_a_stand_s_repeatability_is_reported(servobench: Command, tmp_path: Path) -> None:
    """Three motors, two operators, two trials; the second operator's gains are 1 % higher, and trials differ by 0.2 %."""
    stand, out = tmp_path / "stand", tmp_path / "out"
    stand.mkdir()
    gains = []
    for serial, gain in enumerate((18.0, 20.0, 23.0)):
        for operator, factor in (("ada", 1.0), ("ben", 1.01)):
            for trial in (1, 2):
                gains.append(gain * factor * (1 + 0.002 * trial))
                write_motor(stand / f"{serial}_{operator}_{trial}.csv", gains[-1])
    limits = tmp_path / "limits.toml"
    limits.write_text("[gain]\nlow = 15\nhigh = 25", encoding="utf-8")
    pattern = ("--pattern", "{serial}_{operator}_{trial}.csv")
    servobench("fleet", stand, "--out", out, *pattern, *COLUMNS, *WORKERS)
    study = ("fleet", "repeatability", out, "--parameter", "gain", "--limits", limits)
    ended = servobench(*study, "--operator", "operator", "--trial", "trial", "--json")
    found = valid(ended.out, "repeatability-1")["parameters"]["gain"]
    (stand / "2_ben_2.csv").write_text("torn", encoding="utf-8")
    servobench("fleet", stand, "--out", out, *pattern, *COLUMNS, *WORKERS)
    missing = servobench(*study, "--operator", "operator")
    unknown = servobench(*study, "--operator", "shift")

    assert (found["parts"], found["operators"], found["trials"]) == (3, 2, 2)
    assert f"distinct categories: {found['categories']}, " in ended.err
    exact = gauge_study(np.array(gains).reshape(3, 2, 2))
    for name in ("repeatability", "operator", "part"):
        assert found["components"][name]["sd"] == pytest.approx(exact.components[name].sd, rel=1e-3), name
    assert found["components"]["gauge"]["of_tolerance"] == pytest.approx(
        600 * found["components"]["gauge"]["sd"] / 10
    )
    assert missing.status == 2
    assert "part 2 by ben has 1 usable trials where others have 2" in missing.err
    assert unknown.status == 2
    assert "no column called 'shift'" in unknown.err


def test_ctrl_c_keeps_what_is_done_and_says_how_to_go_on(servobench: Command, tmp_path: Path) -> None:
    stand, out = tmp_path / "stand", tmp_path / "out"
    names = write_fleet(stand, 8)
    words = ["fleet", str(stand), "--out", str(out), *COLUMNS, *WORKERS]
    lines = (
        "import sys",
        "from servobench.cli import main",
        "from servobench.fleet import parts",
        "parts._LONGEST = 0.0",
    )
    program = "\n".join((*lines, "sys.exit(main())"))
    process = subprocess.Popen([sys.executable, "-c", program, *words], stderr=subprocess.PIPE, text=True)
    while not list((out / "parts").glob("part-*.parquet")) and process.poll() is None:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=120)
    kept = len(comparable(out))
    again = servobench(*words)

    assert process.returncode == 130, err
    assert "the same command goes on with the others" in err
    assert f"{len(names) - kept} files done, {kept} before" in again.out
    assert sorted(comparable(out)) == names


def test_a_folder_is_watched(tmp_path: Path) -> None:
    stand, out = tmp_path / "stand", tmp_path / "out"
    stand.mkdir()
    limits = tmp_path / "limits.toml"
    limits.write_text("[gain]\nlow = 15\nhigh = 25", encoding="utf-8")
    words = [
        sys.executable, "-m", "servobench", "fleet", "watch", str(stand), "--out", str(out), *COLUMNS, *WORKERS,
        "--limits", str(limits),
    ]  # fmt: skip
    process = subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"}
    )  # fmt: skip
    assert process.stdout is not None
    first = process.stdout.readline()
    write_motor(stand / "good.csv", 20.0)
    good = process.stdout.readline()
    write_motor(stand / "bad.csv", 30.0)
    bad = process.stdout.readline()
    (stand / "torn.csv").write_text("voltage,speed\n1,2\n", encoding="utf-8")
    torn = process.stdout.readline()
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=120)

    assert "watching" in first
    assert good.startswith("pass      good.csv: gain 20"), good
    assert bad.startswith("fail      bad.csv: gain 30"), bad
    assert "gain is above its limits" in bad
    assert torn.startswith("undecided torn.csv: unusable: the times"), torn
    assert process.returncode == 6, err
    assert {row["file"] for row in rows_in(out)} == {"good.csv", "bad.csv", "torn.csv"}
    assert (out / "report.html").exists()


def test_a_scheduler_that_isn_t_there_is_reported(
    servobench: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(identification, "PATIENCE", "0.5s")
    write_fleet(tmp_path / "stand", 1)
    ended = servobench(
        "fleet", tmp_path / "stand", "--out", tmp_path / "out", "--scheduler", "tcp://127.0.0.1:9", *COLUMNS
    )

    assert ended.status == 2
    assert "--scheduler tcp://127.0.0.1:9: nothing answers there" in ended.err


def test_results_that_are_none_are_reported(servobench: Command, tmp_path: Path) -> None:
    ended = servobench("fleet", "repeatability", tmp_path)

    assert ended.status == 2
    assert "holds no results of a fleet" in ended.err


def test_results_without_a_single_value_are_no_study(servobench: Command, tmp_path: Path) -> None:
    folder = tmp_path / "files"
    folder.mkdir()
    (folder / "empty.csv").write_text("t,u,y\n")
    assert "1 unusable" in servobench("fleet", folder, "--out", tmp_path / "out").out

    ended = servobench("fleet", "repeatability", tmp_path / "out")

    assert ended.status == 2
    assert "none of its files has a result to compare" in ended.err
