"""However a command ends, it says why in a sentence, and its exit status says whose fault it was."""

import errno
import io
import subprocess
import sys
from pathlib import Path

import pytest

from servobench.cli.failures import report_failure
from servobench.cli.terminal import OutputGone
from servobench.core.channels import DeviceInfo
from servobench.core.errors import (
    DeviceError,
    ExperimentError,
    FormatError,
    MissingInformation,
    NotIdentifiable,
    ServobenchError,
    SimulationDiverged,
    StorageError,
    UnitError,
    UnknownName,
    UsageError,
)
from servobench.recordings.recording import Recording, Source
from servobench.rig.lost_device import DeviceLost
from tests.cli.conftest import Command, environment, process

LOST = DeviceLost(
    "it is gone", Recording(name="run", series=(), source=Source(name="twin"), info=DeviceInfo(name="x"))
)


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (UsageError("so"), 2),
        (UnknownName("signal", "sqare", ["square"]), 2),
        (UnitError("so"), 2),
        (ExperimentError("so"), 2),
        (FormatError("so"), 2),
        (MissingInformation("a.csv", ["the unit"]), 2),
        (SimulationDiverged("so"), 2),
        (NotIdentifiable("so"), 3),
        (DeviceError("so"), 4),
        (LOST, 4),
        (StorageError("so"), 5),
        (MemoryError(), 2),
        (PermissionError(errno.EACCES, "Permission denied", "a.html"), 2),
        (OSError(errno.ENOSPC, "No space left on device", "a.html"), 5),
        (OSError(errno.ENOSPC, "No space left on device"), 5),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, Exception) else str(value),
)
def test_an_error_that_is_foreseen_is_a_sentence_and_a_status(
    error: Exception, status: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert report_failure(error) == status

    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("Error: ")
    assert "Traceback" not in said.err


@pytest.mark.parametrize(
    ("error", "status"),
    [(OutputGone(), 5), (BrokenPipeError(errno.EPIPE, "Broken pipe"), 5)],
)
def test_who_has_left_is_told_nothing(
    error: BaseException, status: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert report_failure(error) == status

    assert capsys.readouterr() == ("", "")


def test_who_interrupts_a_command_is_told_so_in_a_sentence(
    servobench: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def interrupted(*args: object, **settings: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("servobench.recordings.reading.recordings_as_stated", interrupted)

    ended = servobench("identify", tmp_path / "any.csv")

    assert ended.status == 130
    assert ended.out == ""
    assert ended.err.strip().splitlines()[-1].startswith("Error: interrupted before there was a result")


def test_every_status_in_the_error_tree_is_one_that_is_documented() -> None:
    def tree(kind: type[ServobenchError]) -> set[type[ServobenchError]]:
        return {kind}.union(*(tree(each) for each in kind.__subclasses__()))

    assert {kind.exit_status for kind in tree(ServobenchError)} == {1, 2, 3, 4, 5}


def test_a_fault_of_ours_is_one_line_and_leaves_its_traceback_in_a_file(
    servobench: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("servobench.cli.catalogue.list_members", lambda *_: {}["no\nsuch"])

    ended = servobench("signals")

    (kept,) = tmp_path.glob("servobench-*.txt")
    assert ended.status == 1
    assert ended.err == (
        f"Error: a fault of servobench, not yours: KeyError: 'no\\nsuch'; please report it with the file {kept}\n"
    )
    assert "Traceback (most recent call last)" in kept.read_text(encoding="utf-8")
    assert "KeyError" in kept.read_text(encoding="utf-8")


def test_where_no_file_can_be_written_the_traceback_is_shown(
    servobench: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "missing"))
    monkeypatch.setattr("servobench.cli.catalogue.list_members", lambda *_: 1 / 0)

    ended = servobench("signals")

    assert ended.status == 1
    assert "ZeroDivisionError: division by zero; please report it" in ended.err
    assert "Traceback (most recent call last)" in ended.err


@pytest.mark.parametrize("words", [("--debug", "signals", "sqare"), ("signals", "sqare", "--debug")])
def test_debug_shows_the_traceback_wherever_it_stands(servobench: Command, words: tuple[str, ...]) -> None:
    ended = servobench(*words)

    assert ended.status == 2
    assert "Traceback (most recent call last)" in ended.err
    assert ended.err.splitlines()[-1].startswith("Error: no signal called 'sqare'")


def test_what_follows_two_dashes_is_a_file_and_no_option(servobench: Command) -> None:
    assert "there is no file --debug" in servobench("inspect", "--", "--debug").err


@pytest.mark.parametrize(
    "words",
    [
        ("idenify",),
        ("identify",),
        ("identify", "--oops"),
        ("signals", "a", "b"),
        ("run", "--seed", "-1"),
        ("run", "--seed", "x"),
        ("inspect", "missing.csv"),
        ("inspect", "."),
        ("identify", "missing.csv"),
        ("convert", "missing.csv", "out.csv"),
        ("recover", "missing.mcap"),
        ("run", "missing.toml"),
        ("run", "--device", "twinn"),
        ("run", "--nominal", "qube"),
        ("run", "--structure", "second"),
        ("devices", "twinn"),
        ("signals", "squre"),
        ("identify", "x.csv", "--sample-time", "3 V"),
        ("identify", "x.csv", "--sample-time", "soon"),
        ("identify", "x.csv", "--nominal", "qube"),
        ("identify", "x.csv", "--structure", "second"),
        ("identify", "x.csv", "--report", "missing/report.html"),
        ("identify", "x.csv", "--report", "."),
    ],
    ids=" ".join,
)
def test_wrong_usage_ends_with_2_and_no_traceback_and_nothing_is_written(
    servobench: Command, words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    ended = servobench(*words)

    assert ended.status == 2
    assert ended.out == ""
    assert "Error: " in ended.err
    assert "Traceback" not in ended.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "content", [b"", b"\0\1\2\3" * 500, b"\x89MCAP0\r\n", b"{", b"a,b\n1,x\n", b"\xff\xfe\0"]
)
@pytest.mark.parametrize("name", ["f.csv", "f.mat", "f.mcap", "f.json", "f"])
def test_a_file_that_is_none_of_ours_ends_with_2(
    servobench: Command, tmp_path: Path, name: str, content: bytes
) -> None:
    file = tmp_path / name
    file.write_bytes(content)

    for command in ("inspect", "identify"):
        ended = servobench(command, file)
        if command == "identify" or content != b"a,b\n1,x\n":
            assert ended.status == 2, ended
        assert "Traceback" not in ended.err
        assert "fault of servobench" not in ended.err


class FullDisk(io.StringIO):
    """An output that nothing more can be written to."""

    def flush(self) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("words", [["--help"], ["--version"], ["signals"]], ids=" ".join)
def test_an_output_that_is_full_ends_with_5(
    words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from servobench.cli import main

    monkeypatch.setattr(sys, "stdout", FullDisk())

    assert main(words) == 5

    assert "No space left on device" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["--help"], ["signals"]], ids=" ".join)
def test_a_reader_that_leaves_is_no_reason_to_complain(words: list[str]) -> None:
    child = subprocess.Popen(
        [sys.executable, "-m", "servobench", *words],
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert child.stdout is not None
    child.stdout.close()
    _, err = child.communicate(timeout=60)

    assert (child.returncode, err) == (5, b"")


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has a device that is always full")
def test_what_is_still_in_the_buffer_when_the_disk_is_full_is_an_error_too() -> None:
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(
            [sys.executable, "-m", "servobench", "signals"], env=environment(), stdout=full, stderr=subprocess.PIPE
        )  # fmt: skip

    assert (ended.returncode, ended.stderr) == (
        5,
        b"Error: the output can't be written: No space left on device\n",
    )


@pytest.mark.parametrize("words", [["--help"], ["signals"]], ids=" ".join)
def test_a_process_without_any_output_doesn_t_fail(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    from servobench.cli import main

    monkeypatch.setattr(sys, "stdout", None)

    assert main(words) == 0


@pytest.mark.parametrize("encoding", ["cp1252", "ascii", "cp437", "utf-8"])
def test_words_are_spelled_for_the_output_that_there_is(encoding: str) -> None:
    ended = process("devices", PYTHONIOENCODING=encoding)

    assert (ended.status, ended.err) == (0, "")
    assert {"utf-8": "kg·m²", "cp1252": "kg·m²", "cp437": "kg·m²", "ascii": "kg*m^2"}[encoding] in ended.out


@pytest.mark.parametrize(
    ("encoding", "said"),
    [("ascii", "3x10^-7 1x10^12 m/s^2 s^2"), ("cp1252", "3×10^-7 1×10¹² m/s² s²")],
)
def test_no_digit_of_an_exponent_is_lost_where_the_output_has_none(encoding: str, said: str) -> None:
    """Code pages have ¹²³ and no other: of 10⁻⁷ there was left `10^-?`."""
    from servobench.cli.terminal import spell_what_cannot_be_encoded

    spell_what_cannot_be_encoded()

    assert "3×10⁻⁷ 1×10¹² m/s² s²".encode(encoding, "servobench.spelled").decode(encoding) == said


def test_words_in_a_pipe_have_no_colours() -> None:
    assert "\x1b" not in process("signals").out


def test_no_colours_are_used_where_they_aren_t_wanted(
    servobench: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    from servobench.cli.terminal import output

    class Screen(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr(sys, "stdout", Screen())
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert output().color_system is not None

    monkeypatch.setenv("NO_COLOR", "1")
    assert output().no_color


def test_a_file_can_t_steer_the_terminal(servobench: Command, tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("t [s],\x1b[31mu [V],y [deg]\n" + "".join(f"{k},{k % 2},{k}\n" for k in range(999)))

    said = servobench("inspect", file)

    assert said.status == 0
    assert "[31mu" in said.out
    assert "\x1b" not in said.out


def test_a_file_whose_name_begins_with_a_dash_is_shown_how_to_be_named(
    servobench: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("-log.csv").write_text("t,u,y\n")

    ended = servobench("inspect", "-log.csv")

    assert ended.status == 2
    assert "No such option: -l" in ended.err
    assert ended.err.endswith("for the file, write ./-log.csv\n")
    # What isn't there can't be meant, and what is named so is read.
    assert "write ./" not in servobench("inspect", "-lag.csv").err
    assert "log.csv" in servobench("inspect", "./-log.csv").err
