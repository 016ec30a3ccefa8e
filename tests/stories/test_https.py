"""The panel as it is served to others: https, with a certificate, and a token all the same."""

from __future__ import annotations

import http.client
import shutil
import ssl
import subprocess
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the panel's extra is absent: starlette")
pytest.importorskip("uvicorn", reason="the panel's extra is absent: uvicorn")

from tests.stories.program import Page, Program, running


def certificate(folder: Path) -> tuple[Path, Path]:
    """A certificate for this machine that nobody has signed but itself, and its key."""
    cert, key = folder / "cert.pem", folder / "key.pem"
    command = shutil.which("openssl")
    assert command is not None, "the command openssl isn't there to make a certificate with"
    asked = "req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 1 -subj /CN=localhost"
    named = ("-addext", "subjectAltName=IP:127.0.0.1", "-keyout", str(key), "-out", str(cert))
    subprocess.run([command, *asked.split(), *named], check=True, capture_output=True, timeout=60)
    return cert, key


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("https")


@pytest.fixture(scope="module")
def program(folder: Path) -> Iterator[Program]:
    cert, key = certificate(folder)
    with running(folder, "--tls-cert", str(cert), "--tls-key", str(key)) as found:
        yield found


def test_a_page_over_https_drives_the_motor_by_an_encrypted_socket(browser: Any, program: Program) -> None:
    sockets: set[str] = set()
    assert program.base.startswith("https://127.0.0.1:")
    with Page(browser, program.address, ignore_https_errors=True) as page:
        page.page.on("websocket", lambda socket: sockets.add(socket.url))
        page.page.reload()
        page.drive()
        page.start()
        page.until(lambda: page.reading("Voltage", "Applied") > 0)
        page.page.keyboard.press("Escape")
        page.page.locator("#run-text").get_by_text("Zero volts").wait_for()
        (cookie,) = page.context.cookies()
        assert page.complaints == []

    assert sockets == {f"wss://127.0.0.1:{program.port}/ws"}
    assert cookie["name"] == f"servobench_session_{program.port}"
    assert (cookie["secure"], cookie["httpOnly"], cookie["sameSite"]) == (True, True, "Strict")


def test_over_https_the_certificate_is_the_one_that_was_given_and_the_token_is_asked_for(
    program: Program, folder: Path
) -> None:
    trusting = ssl.create_default_context(cafile=str(folder / "cert.pem"))
    with urllib.request.urlopen(f"{program.base}/static/page.js", context=trusting, timeout=30) as page:
        assert page.status == 200
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(f"{program.base}/", context=trusting, timeout=30)
    with refused.value as answer:
        assert answer.code == 401


def test_without_https_nothing_is_answered_there(program: Program) -> None:
    with pytest.raises((urllib.error.URLError, http.client.HTTPException, ConnectionError)):
        urllib.request.urlopen(f"{program.base.replace('https', 'http')}/", timeout=30)
