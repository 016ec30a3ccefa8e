"""A page in the file system that opens the panel in this machine's browser, so that the key isn't in an address.

What stands in an address stays in the browser's history, and the command that opens a browser can be read by everybody on the
machine. The page's form has the key and sends itself; only its owner can read it.
"""

from __future__ import annotations

import os
import shutil
import stat
import sys
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from html import escape
from pathlib import Path
from tempfile import mkdtemp
from threading import Event, Thread

from servobench.panel.keys import LOCAL_TIME

_END_TIME = 5.0  # s
_PAGE = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="referrer" content="no-referrer">
<title>servobench panel</title>
<form method="post" action="{address}open">
<input type="hidden" name="token" value="{key}">
<button>Open the panel</button>
</form>
<script>document.forms[0].submit();</script>
</html>
"""


class LocalPage:
    """The page, from `open` until it was `used`, its key is over, or `end`."""

    def __init__(self) -> None:
        self._over = Event()
        self._used = False
        self._thread: Thread | None = None

    def open(self, address: str, key: str, folder: Path, unused: Callable[[], None]) -> None:
        """Write it for the panel at an address and have the browser open it; `unused` is called if no browser does in time."""

        def wait() -> None:
            with (
                suppress(OSError),
                write_page(address, key, folder) as file,
            ):  # a full disk has no place for it
                Thread(target=webbrowser.open, args=(file.as_uri(),), daemon=True).start()
                self._over.wait(LOCAL_TIME)
            if not self._over.is_set():
                unused()

        self._thread = Thread(target=wait, daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Remove it, and wait until it is."""
        self.discard()
        if self._thread is not None:
            self._thread.join(_END_TIME)

    def discard(self) -> None:
        """Remove it without waiting for that."""
        self._over.set()


@contextmanager
def write_page(address: str, key: str, folder: Path) -> Iterator[Path]:
    """Give the file of the page, which is there meanwhile: mode 0600, in a new folder of mode 0700.

    On Linux that is in `folder`: browsers that come as snaps see no others than the home folder's.
    """
    place = _private_folder(folder if sys.platform == "linux" else None)
    try:
        file = place / "open.html"
        text = _PAGE.format(address=escape(address), key=escape(key))
        with os.fdopen(
            os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8"
        ) as out:
            out.write(text)
        yield file
    finally:
        shutil.rmtree(place, ignore_errors=True)


def _private_folder(folder: Path | None) -> Path:
    """Make a folder that only its owner can read: in the wanted one, or, where that keeps no permissions, in the system's."""
    if folder is not None:
        with suppress(OSError):
            place = Path(mkdtemp(prefix=".open-", dir=folder.resolve()))
            if stat.S_IMODE(place.stat().st_mode) == 0o700:
                return place
            place.rmdir()
    return Path(mkdtemp(prefix="servobench-"))
