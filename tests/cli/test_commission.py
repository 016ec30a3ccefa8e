"""`servobench commission` as a user types it: the folder, the report, the sign-off, and every way in which it is used wrongly."""

import json
import os
import signal
import sys
import time
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from servobench.cli.commission import Hand
from servobench.cli.progress import Progress
from servobench.recordings.native.reader import read
from servobench.rig.commission.checks.base import CHECKS
from tests.cli.conftest import Command, in_a_fork, started

SOUND = "twin watchdog=50ms counter_bits=16"


def checked(text: str) -> dict[str, Any]:
    """The only object in a text, which keeps to its schema."""
    schema = json.loads(
        files("servobench").joinpath("rig/schemas/commission-1.json").read_text(encoding="utf-8")
    )
    jsonschema.Draft202012Validator.check_schema(schema)
    found: dict[str, Any] = json.loads(text)
    checker = jsonschema.Draft202012Validator.FORMAT_CHECKER
    jsonschema.Draft202012Validator(schema, format_checker=checker).validate(found)
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bench that was commissioned and signed off; tests only read in it."""
    out = tmp_path_factory.mktemp("commissioned") / "bench"
    ended = in_a_fork(
        "commission", SOUND, "--out", out, "--signed-by", "Ada <Lovelace>", "--signed-on", "2026-11-20"
    )
    assert ended.status == 0, ended.err
    return out


def test_the_folder_holds_outcome_report_and_a_recording_for_each_run(folder: Path) -> None:
    found = checked((folder / "commission.json").read_text(encoding="utf-8"))
    names = {name for check in found["checks"] for name in check["recordings"]}

    assert {path.name for path in folder.iterdir()} == {
        "commission.json",
        "report.html",
        *(f"{name}.mcap" for name in names),
    }
    assert [check["name"] for check in found["checks"]] == sorted(
        CHECKS.names(), key=lambda name: CHECKS[name].place
    )
    (recording,) = read(folder / "04-stop.mcap")
    assert recording.stopped.reason == "finished"
    assert found["signed"] == {"name": "Ada <Lovelace>", "date": "2026-11-20"}
    assert found["device"]["settings"]["watchdog"] == "0.05"


def test_the_report_says_of_each_check_what_was_done_measured_and_expected(folder: Path) -> None:
    page = (folder / "report.html").read_text(encoding="utf-8")
    found = checked((folder / "commission.json").read_text(encoding="utf-8"))

    for check in found["checks"]:
        assert check["title"] in page
        assert check["did"].partition(";")[0].split("'")[0] in page
    for word in ("Done", "Expected", "Measured", "What to do", "Firmware", "Settings", "Software"):
        assert f"<dt>{word}</dt>" in page
    assert "Ada &lt;Lovelace&gt;" in page
    assert "2026-11-20" in page
    pictures = [name for name in CHECKS.names() if CHECKS[name].picture]
    assert pictures
    for name in pictures:
        assert f'id="figure-check-{name.replace("_", "-")}"' in page
    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org", "")


def test_json_is_all_there_is_on_standard_output(servobench: Command, tmp_path: Path) -> None:
    ended = servobench("commission", SOUND, "--out", tmp_path / "new", "--json")

    assert ended.status == 0
    found = checked(ended.out)
    assert found == checked((tmp_path / "new" / "commission.json").read_text(encoding="utf-8"))
    assert "verified" in ended.err
    (turns,) = [check for check in found["checks"] if check["name"] == "turns"]
    assert turns["state"] == "unknown"
    assert "--turns 1" in turns["remedy"]


def test_a_check_that_fails_is_status_4_and_says_what_to_do(servobench: Command, tmp_path: Path) -> None:
    ended = servobench("commission", "twin delay=8ms", "--out", tmp_path / "new")

    assert ended.status == 4
    assert "failed" in ended.out
    assert "Find the cause" in " ".join(ended.out.split())
    assert "Failed." in ended.out
    assert (tmp_path / "new" / "report.html").is_file()


@pytest.mark.parametrize(
    ("words", "status", "expected"),
    [
        (["twim"], 2, "did you mean 'twin'"),
        (["twin dely=8ms"], 2, "dely"),
        (["twin delay=fast"], 2, "delay"),
        (["rig"], 2, "its setting 'port' is missing"),
        (["rig:/dev/there-is-none"], 4, "can't be opened"),
        (["rig:/dev/there-is-none watchdog=5s"], 2, "expected 20 to 500"),
        (["quanser"], 4, "Quanser's Python package isn't installed"),
        (["replay file=none.mcap"], 2, "none.mcap"),
        (["twin", "--voltage-limit", "0V"], 2, "expected one above 0 V"),
        (["twin", "--voltage-limit", "a lot"], 2, "--voltage-limit a lot"),
        (["twin", "--turns", "1"], 2, "nobody can turn the shaft"),
        (["twin timing=host", "--turns", "0"], 2, "above 0"),
        (["twin", "--signed-on", "2026-11-20"], 2, "by whom"),
        (["twin", "--signed-by", " "], 2, "expected a name"),
        (["twin", "--signed-by", "Ada", "--signed-on", "Friday"], 2, "such as 2026-11-23"),
        (["twin", "--out", "there"], 2, "isn't an empty folder"),
    ],
)
def test_a_mistake_is_a_sentence_and_leaves_no_folder(
    servobench: Command,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: list[str],
    status: int,
    expected: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "kept").touch()
    ended = servobench("commission", *words)

    assert ended.status == status, ended.err
    assert expected in ended.err
    assert "Traceback" not in ended.err
    assert [path.name for path in tmp_path.iterdir()] == ["there"]


def test_a_log_can_not_be_commissioned(
    servobench: Command, tmp_path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ended = servobench("commission", f"replay file={folder / '04-stop.mcap'}")

    assert ended.status == 2
    assert "nothing can drive it" in ended.err
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform == "win32", reason="a request to end goes another way there")
@pytest.mark.promise("S67")
def test_ctrl_c_in_real_time_ends_with_zero_volts_and_a_report(tmp_path: Path) -> None:
    out = tmp_path / "bench"
    with started("commission", "twin timing=host watchdog=80ms", "--out", out) as child:
        deadline = time.monotonic() + 200
        # The run of the first check that drives is being recorded; of its 1150 rows some are on disk.
        part = out / "04-stop.mcap.part"
        while not (part.exists() and part.stat().st_size > 10_000) and time.monotonic() < deadline:
            time.sleep(0.02)
        os.kill(child.pid, signal.SIGINT)
        _, err = child.communicate(timeout=100)

    assert child.returncode == 130, err
    found = checked((out / "commission.json").read_text(encoding="utf-8"))
    states = {check["name"]: check["state"] for check in found["checks"]}
    assert states["rest"] == states["noise"] == "verified"
    assert states["stop"] == states["sign"] == "unknown"
    assert "interrupted" in found["ended"]
    (recording,) = read(out / "04-stop.mcap")
    assert recording.stopped.reason == "interrupted"
    assert (out / "report.html").is_file()


def test_somebody_who_is_asked_ends_the_turning_with_enter(monkeypatch: pytest.MonkeyPatch) -> None:
    class Lines:
        def __init__(self) -> None:
            self.read = 0

        def readline(self) -> str:
            self.read += 1
            return "\n"

    keyboard = Lines()
    monkeypatch.setattr("sys.stdin", keyboard)
    patience, look = Hand(2.0, True, Progress()).begin()

    assert patience > 60
    assert look is not None
    deadline = time.monotonic() + 60
    while look(None) is None and time.monotonic() < deadline:  # type: ignore[arg-type]
        pass
    assert look(None) == "the shaft was turned"  # type: ignore[arg-type]
    assert keyboard.read == 2


def test_somebody_who_can_not_answer_gets_a_time(capsys: pytest.CaptureFixture[str]) -> None:
    patience, look = Hand(1.0, False, Progress()).begin()

    assert look is None
    assert f"{patience:g} s" in capsys.readouterr().err
