"""`servobench stability`: what is said of a run, a result and a recording, and what is refused."""

from pathlib import Path

import pytest

from tests.cli.conftest import Command


def test_a_run_and_its_result_say_the_same(servobench: Command, finished_run: Path) -> None:
    said = [servobench("stability", path) for path in (finished_run, finished_run / "result.json")]

    assert [each.status for each in said] == [0, 0]
    assert said[0].out == said[1].out
    assert "To the speed: stable, BIBO stable" in said[0].out
    assert "To the position: marginally stable, not BIBO stable" in said[0].out
    assert "A constant as input" in said[0].out
    assert "The position loop with 1 V/rad: stable" in said[0].out


def test_a_recording_says_what_it_leaves_open_too(servobench: Command, finished_run: Path) -> None:
    said = servobench("stability", finished_run / "recording.mcap", "--kp", "2 V/rad")

    assert said.status == 0, said.err
    words = " ".join(said.out.split())
    assert "No finite record proves" in words
    assert "The position loop with 2 V/rad: stable" in words
    assert "Over the 95 % intervals the closed loop is stable everywhere" in words


def test_too_much_gain_is_unstable_by_its_delay(servobench: Command, finished_run: Path) -> None:
    """With τ = 0.1 s, K = 24 and a delay of 0.14 ms the limit is near ω = √(1/(τ d)) = 267 rad/s, kp = τω²/K = 300 V/rad."""
    for kp, verdict in (("200", "stable"), ("400", "unstable")):
        said = servobench("stability", finished_run, "--kp", kp)

        assert said.status == 0
        assert f"The position loop with {kp} V/rad: {verdict}" in said.out
        words = " ".join(said.out.split())
        assert ("goes round -1 twice, clockwise" in words) == (verdict == "unstable")


@pytest.mark.parametrize(
    ("words", "because"),
    [(("--kp", "2 A"), "--kp 2 A"), (("--kp", "0"), "there is no loop"), (("--kp", "much"), "--kp much")],
)
def test_a_gain_that_is_none_is_told(
    servobench: Command, finished_run: Path, words: tuple[str, ...], because: str
) -> None:
    ended = servobench("stability", finished_run, *words)

    assert ended.status == 2
    assert because in ended.err
    assert "Traceback" not in ended.err


def test_a_result_that_is_not_there_is_told(servobench: Command, tmp_path: Path) -> None:
    ended = servobench("stability", tmp_path / "nothing.json")

    assert ended.status == 2
    assert "there is no result" in ended.err
