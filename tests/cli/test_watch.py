"""A mistake in what is watched, or how, is one sentence, and leaves no folder."""

from io import StringIO
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import pytest
from rich.console import Console

from servobench.cli.live_text import LiveText
from servobench.cli.watch import _follow
from servobench.identification.watch import Watch, stop_text
from servobench.recordings.formats.mapping import Mapping
from servobench.recordings.streams.base import Rows
from tests.cli.conftest import Command


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("nowhere.csv",), "isn't a source of rows"),
        (("udp:0", "--stop-after", "soon"), "--stop-after soon"),
        (("udp:0", "--stop-after", "0s"), "expected a time above 0"),
        (("udp:0", "--until", "gain"), "isn't a target"),
        (("udp:0", "--recording", "a"), "a stream is one recording"),
        (("udp:0", "--stop-after", "0.2s", "--out", "out"), "no usable rows came"),
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


def test_a_terminal_shows_ten_states_a_second_however_often_rows_come(tmp_path: Path) -> None:
    written, clock = StringIO(), iter(0.5 * k for k in range(2000))
    watch = Watch(Mapping(), "test", tmp_path / "a.mcap")
    with LiveText(Console(file=written, force_terminal=True), now=lambda: next(clock) / 100) as live:
        for _ in range(200):
            live.show(watch, 0.0)

    assert 10 <= written.getvalue().count("waiting for rows") <= 20


class Backlog:
    """A stream of 2000 rows that come at once, and 100 more a look later."""

    name = "backlog"

    def __init__(self) -> None:
        t = 0.005 * np.arange(2100)
        values = np.column_stack([t, np.sign(np.sin(t)), np.floor(100 * t)])
        self._rows = [Rows(names=("t", "u", "counts"), values=part) for part in np.split(values, [2000])]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass

    def read(self, patience: float) -> Rows | None:
        return self._rows.pop(0)


def test_what_had_come_when_the_end_was_asked_for_is_recorded(tmp_path: Path) -> None:
    watch = Watch(Mapping(counts_per_rev=2048), "test", tmp_path / "a.mcap")
    stream, asked = Backlog(), iter([False, True, True])
    reason = _follow(stream, watch, lambda silence: None, lambda: next(asked), None, False)
    watch.end(stop_text(reason))

    assert reason == "interrupted"
    assert watch.rows == 2100
