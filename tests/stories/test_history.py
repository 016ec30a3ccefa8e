"""A browser's history of a panel that was opened in it, read as the file that it is, opens nothing."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import sqlite3
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest

pytest.importorskip("starlette", reason="the panel's extra is absent: starlette")
pytest.importorskip("uvicorn", reason="the panel's extra is absent: uvicorn")

from tests.panel.browser import FLAGS, NAMES
from tests.stories.program import PATIENCE, Program, running, started

pytestmark = pytest.mark.skipif(
    sys.platform == "win32", reason="the browser there isn't named by the environment"
)


def wait_for(what: Callable[[], Any]) -> Any:
    """Return what something gives once it gives anything; how long doesn't matter, but not for ever."""
    until = time.monotonic() + PATIENCE
    while not (found := what()):
        assert time.monotonic() < until, "it never came to be so"
        time.sleep(0.05)
    return found


@dataclass(frozen=True)
class Desktop:
    """An environment with a screen, in which `webbrowser` has a command open an address, which is kept."""

    folder: Path
    opens: str = ""

    @property
    def environment(self) -> dict[str, str]:
        script = self.folder / "browser"
        kept = shlex.quote(str(self.folder / "asked"))
        script.write_text(f'#!/bin/sh\nprintf "%s\\n" "$1" >> {kept}\n{self.opens}\n', encoding="utf-8")
        script.chmod(0o700)
        return {**os.environ, "BROWSER": str(script), "DISPLAY": ":none"}

    @property
    def asked(self) -> list[str]:
        """The addresses that were to be opened, whole lines of them."""
        file = self.folder / "asked"
        return file.read_text(encoding="utf-8").splitlines() if file.exists() else []


@contextmanager
def chromium_in(folder: Path, browser: Any) -> Iterator[tuple[Desktop, Callable[[], Any]]]:
    """A desktop whose browser is Chromium with a profile in a folder, and what connects to it once it runs; it is ended."""
    path = next(filter(None, map(shutil.which, NAMES)))
    profile, number = folder / "profile", folder / "pid"
    words = [
        path,
        *FLAGS,
        "--headless=new",
        "--window-size=1440,900",
        f"--user-data-dir={profile}",
        "--remote-debugging-port=0",
    ]
    command = f'{shlex.join(words)} "$1" >/dev/null 2>&1 &\necho $! > {shlex.quote(str(number))}'

    def connected() -> Any:
        lines = wait_for(
            lambda: (file := profile / "DevToolsActivePort").exists() and file.read_text().split()
        )
        return browser.browser_type.connect_over_cdp(f"http://127.0.0.1:{lines[0]}")

    try:
        yield Desktop(folder, command), connected
    finally:
        if number.exists():
            with suppress(ProcessLookupError):
                os.kill(int(number.read_text()), signal.SIGKILL)


def history(profile: Path) -> list[str]:
    """All addresses that the history of a browser has that was ended."""
    with closing(sqlite3.connect(f"file:{profile}/Default/History?mode=ro", uri=True)) as file:
        return [row[0] for row in file.execute("select url from urls")]


def opens(program: Program, url: str) -> bool:
    """Whether somebody without a cookie gets a session by an address."""
    with httpx.Client(follow_redirects=True, timeout=30.0) as client:
        client.get(url)
        return client.get(f"{program.base}/api/session", headers={"sec-fetch-site": "same-origin"}).is_success


@pytest.mark.promise("S61")
def test_nothing_in_the_history_of_a_browser_opens_the_panel_that_was_opened_in_it(
    browser: Any, tmp_path: Path
) -> None:
    profile = tmp_path / "profile"
    with (
        chromium_in(tmp_path, browser) as (desktop, connected),
        running(tmp_path, "--viewer", environment=desktop.environment) as program,
    ):
        own = connected()
        page = own.contexts[0].pages[0]
        page.context.set_default_timeout(20000)
        page.wait_for_url(f"{program.base}/")
        page.get_by_text("You drive").wait_for()
        page.reload()
        page.get_by_text("You drive").wait_for()
        second = page.context.new_page()
        second.goto(program.base)
        second.wait_for_selector("body.ready")
        used = program.address
        third = page.context.new_page()
        third.goto(used)  # the printed link, in the same browser, and once more
        third.wait_for_selector("body.ready")
        third.goto(used)
        third.wait_for_selector("body.ready")
        page.context.clear_cookies()
        third.goto(used)
        third.get_by_text("there is a new one in the panel's terminal").wait_for()
        code = re.findall(r"with the code (\S+)", program.terminal.said)[0]
        third.get_by_label("Or type the code").fill(code)
        third.get_by_role("button", name="Watch").click()
        third.wait_for_selector("body.ready")
        assert third.url == f"{program.base}/"
        own.new_browser_cdp_session().send("Browser.close")
        urls = wait_for(lambda: not (profile / "SingletonLock").is_symlink() and history(profile))

        assert f"{program.base}/" in urls
        assert used in urls  # browsers keep it: it has to open nothing
        assert not [url for url in urls if code in url]
        assert [url for url in urls if url.startswith("http") and opens(program, url)] == []
        fresh = program.address
        assert opens(program, fresh)  # what shows that the question can be answered with yes
    assert fresh not in urls


@pytest.mark.promise("S61")
def test_the_local_page_is_its_owners_alone_and_is_gone_once_it_was_used_or_the_panel_ends(
    tmp_path: Path,
) -> None:
    desktop = Desktop(tmp_path)
    program = started(tmp_path, environment=desktop.environment)
    try:
        (address,) = wait_for(lambda: desktop.asked)
        file = Path(httpx.URL(address).path)
        text = file.read_text(encoding="utf-8")
        (key,) = re.findall(r'name="token" value="([\w-]+)"', text)
        assert address.startswith("file:///")
        assert key not in address
        assert [oct(each.stat().st_mode & 0o777) for each in (file, file.parent)] == ["0o600", "0o700"]
        assert f'action="{program.base}/open"' in text
        assert key not in program.terminal.said

        headers = {"origin": "null", "sec-fetch-site": "cross-site"}
        answer = httpx.post(f"{program.base}/open", data={"token": key}, headers=headers, timeout=30.0)
        assert answer.status_code == 200
        wait_for(lambda: not file.parent.exists())
        assert "for another browser" not in program.terminal.said  # the printed link is still fresh
    finally:
        program.terminal.end(signal.SIGINT)


@pytest.mark.promise("S61")
@pytest.mark.parametrize("request_", [signal.SIGINT, signal.SIGTERM], ids=["Ctrl-C", "SIGTERM"])
def test_a_local_page_that_no_browser_used_ends_with_the_panel(tmp_path: Path, request_: int) -> None:
    desktop = Desktop(tmp_path)
    program = started(tmp_path, environment=desktop.environment)
    try:
        (address,) = wait_for(lambda: desktop.asked)
        file = Path(httpx.URL(address).path)
        assert file.exists()
    finally:
        program.terminal.end(request_)
    assert not file.parent.exists()
