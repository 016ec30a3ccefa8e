"""`servobench panel`: what isn't safe has to be asked for, and each mistake gets a sentence before anything is opened."""

from __future__ import annotations

import socket
import sys
from pathlib import Path

import pytest

from servobench.cli import main, panel
from servobench.core.errors import UsageError
from servobench.panel.library import Library
from servobench.panel.server import PORT, listen


def said(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    assert main(["panel", "--no-open", *words]) == 2
    return capsys.readouterr().err


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.7", "::", "lab.example"])
def test_another_address_needs_tls_or_a_word(host: str, capsys: pytest.CaptureFixture[str]) -> None:
    text = said(["--host", host], capsys)

    assert "--tls-cert" in text
    assert "--without-tls" in text


def test_a_certificate_needs_its_key_and_both_have_to_be_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    certificate = tmp_path / "c.pem"
    certificate.write_text("")

    assert "go together" in said(["--tls-cert", str(certificate)], capsys)
    assert "no such file" in said(
        ["--tls-cert", str(certificate), "--tls-key", str(tmp_path / "k.pem")], capsys
    )


def test_without_the_extra_it_says_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [*sys.modules]:
        if name.startswith(("servobench.panel", "starlette", "uvicorn")):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "starlette", None)

    assert 'pip install "servobench[panel]"' in said([], capsys)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--device", "twi"], "twin"),
        (["--experiment", "nowhere.toml"], "nowhere.toml"),
        (["--folder", "{file}"], "--folder"),
    ],
)
def test_a_mistake_is_reported_before_anything_is_opened(
    words: list[str], named: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "file"
    file.write_text("")
    words = [word.replace("{file}", str(file)) for word in ["--folder", str(tmp_path / "r"), *words]]

    status = main(["panel", "--no-open", "--port", "0", *words])

    assert status in (2, 5)
    assert named in capsys.readouterr().err


def test_a_port_that_is_taken_is_reported_and_one_that_was_not_asked_for_is_left_alone() -> None:
    with listen("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(UsageError, match=f"port {port}.*port=0"):
            listen("127.0.0.1", port)
    with listen("127.0.0.1", None) as first, listen("127.0.0.1", None) as second:
        assert first.getsockname()[1] != second.getsockname()[1]
        assert PORT not in (second.getsockname()[1],)


@pytest.mark.skipif(
    sys.platform == "win32", reason="Windows frees a port at once, and has another meaning for the option"
)
def test_the_port_of_a_panel_that_was_killed_is_free_at_once() -> None:
    with listen("127.0.0.1", 0) as first:
        port = first.getsockname()[1]
        page = socket.create_connection(("127.0.0.1", port))
        served, _ = first.accept()
        served.close()  # the panel's end is closed first, as where it's killed; the line then lingers
        page.close()
    with listen("127.0.0.1", port) as second:
        assert second.getsockname()[1] == port


def test_a_second_panel_on_the_same_folder_is_refused_and_told_where_the_first_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    library = Library(tmp_path)
    library.prepare()
    words = ["panel", "--no-open", "--port", "0", "--folder", str(tmp_path)]
    with library.hold("http://127.0.0.1:8765/"):
        status = main(words)

    said = capsys.readouterr().err
    assert status == 2
    assert "in use by another panel (http://127.0.0.1:8765/)" in said
    assert "--folder" in said
    with library.hold("http://127.0.0.1:8766/"):  # it is free again
        assert library.list() == []


def test_the_sockets_that_it_takes_are_of_tcp_by_their_own_word() -> None:
    # Or else asyncio leaves Nagle's wait on, and each frame comes 40 ms late.
    with listen("127.0.0.1", 0) as found:
        assert found.proto == socket.IPPROTO_TCP


def test_the_names_that_it_answers_to_are_those_of_its_address() -> None:
    assert panel._names("127.0.0.1") == ["127.0.0.1", "localhost"]
    assert panel._names("lab.example") == ["lab.example"]
    assert "127.0.0.1" in panel._names("0.0.0.0")
