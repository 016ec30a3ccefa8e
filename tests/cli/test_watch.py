"""A mistake in what is watched, or how, is one sentence, and leaves no folder."""

from pathlib import Path

import pytest

from tests.cli.conftest import Command


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("nowhere.csv",), "no source of rows"),
        (("udp:0", "--stop-after", "soon"), "--stop-after soon"),
        (("udp:0", "--stop-after", "0s"), "expected a time above 0"),
        (("udp:0", "--until", "gain"), "isn't a target"),
        (("udp:0", "--recording", "a"), "a stream is one recording"),
        (("udp:0", "--stop-after", "0.2s", "--out", "out"), "no rows came"),
        (("-",), "standard input"),
    ],
)
def test_a_mistake_is_a_sentence(
    servobench: Command,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    expected: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin", None)
    ended = servobench("watch", *words)

    assert ended.status == 2
    assert expected in ended.err
    assert not list(tmp_path.iterdir())
