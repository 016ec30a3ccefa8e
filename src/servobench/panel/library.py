"""The folder of recordings: a folder for each, with data, result and notes."""

from __future__ import annotations

import json
import os
import re
import shutil
import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from pathlib import Path
from tempfile import NamedTemporaryFile
from threading import Lock
from typing import Any

from servobench.core.errors import FormatError, StorageError, UnknownName, UsageError
from servobench.recordings.native.lease import hold

RECORDING = "recording.mcap"
EXPERIMENT = "experiment.toml"
RESULT = "result.json"
MAPPING = "mapping.toml"
REPORT = "report.html"
ABOUT = "about.json"
TRASH = ".trash"
LEASE = ".panel"  # held by the panel that has the folder; says at which address that is
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
_DEVICES = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?", re.IGNORECASE)
_LONGEST_NOTES = 10_000
_LONGEST_FITTED = 56  # letters, so that a number fits behind it


@dataclass(frozen=True, kw_only=True)
class About:
    """A recording's facts without reading it: when it was created (local time), its duration [s], the number of samples.

    `signal` is what drove the motor, `notes` are the user's, `verdict` is that of its identification; empty where there is none.
    """

    created: str = ""
    duration: float = 0.0
    samples: int = 0
    signal: str = ""
    notes: str = ""
    verdict: str = ""
    columns: str = ""
    """Of an imported file: "open" where the user has to say what its columns are, "said" or "known" where that is known."""
    warnings: tuple[str, ...] = ()
    """Warnings from reading it, such as a damaged file whose end is missing: a sentence each."""


def check_name(name: object) -> str:
    """Return a name that a recording may have; raises `UsageError` for any other.

    Up to 64 letters, digits, dots, underscores and hyphens of ASCII, of which the first is a letter or a digit. Names that mean
    a device to some system (`con`, `nul.txt`), and those that end in a dot, which others drop, are none.
    """
    if (
        not isinstance(name, str)
        or not _NAME.fullmatch(name)
        or _DEVICES.fullmatch(name)
        or name.endswith(".")
    ):
        raise UsageError(
            f"{str(name)[:80]!r} can't be the name of a recording; expected up to 64 letters, digits, dots, _ and -, "
            "starting with a letter or a digit"
        )
    return name


def nearest_name(text: str) -> str:
    """Return the name of a recording that is nearest to a text: letters without their accents, `-` for what can't stand there."""
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", plain).lstrip("._-")[:_LONGEST_FITTED].rstrip("._-")
    if not name or _DEVICES.fullmatch(name):
        name = f"import-{name}".rstrip("-")
    return check_name(name)


class Library:
    """The recordings in one folder. Nothing outside of it is read or written, and nothing in it that is a symbolic link."""

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)
        self._trash = self.folder / TRASH
        self._noting = Lock()  # what is known is read and written again, by whatever thread

    def prepare(self) -> None:
        """Make the folder where it isn't there; raises `StorageError` where that can't be."""
        try:
            self._trash.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StorageError(
                f"the folder for recordings {self.folder} can't be created: {error.strerror or error}; give another "
                "`folder=...`"
            ) from error

    @contextmanager
    def hold(self, address: str) -> Iterator[None]:
        """Lock the folder for this panel; `address` is what other panels refer their users to.

        However this process ends, the folder is free again then. Raises `UsageError` where another panel has it, and
        `StorageError` where that can't be known.
        """
        path = self.folder / LEASE
        try:
            path.touch()
            file = path.open("r+b")
        except OSError as error:
            raise StorageError(
                f"{path} can't be written: {error.strerror or error}; give another `folder=...`"
            ) from error
        with file:
            if not hold(file):
                where = file.read(200).decode("utf-8", "replace").strip()
                raise UsageError(
                    f"{self.folder} is in use by another panel{f' ({where})' if where else ''}: use its page, or end it first, "
                    "or give another `folder=...`"
                )
            file.truncate()
            file.write(address.encode())
            file.flush()
            try:
                yield
            finally:
                file.truncate(0)

    def new(self, name: str | None = None) -> Path:
        """Make a folder for a new recording, called `name` or after the time, and return it.

        Raises `UsageError` for a name that can't be or is taken, `StorageError` where the folder can't be made.
        """
        made = self._make_folder([check_name(name)] if name else _times())
        if made is None:
            raise UsageError(
                f"there is a recording called {name!r} already, maybe a deleted one; give another name"
            )
        return made

    def new_like(self, text: str) -> Path:
        """Make a folder for a new recording, with a name near to `text` that isn't taken yet.

        Raises `StorageError`, and `UsageError` where a thousand are called so.
        """
        name = nearest_name(text)
        made = self._make_folder([name, *(f"{name}-{again}" for again in range(2, 1000))])
        if made is None:
            raise UsageError(f"there are a thousand recordings called {name!r} already; rename the file")
        return made

    def _make_folder(self, candidates: Iterable[str]) -> Path | None:
        """Make a folder with the first of some names that isn't taken; None where all are."""
        taken = {each.name.casefold() for each in (*self._entries(self.folder), *self._entries(self._trash))}
        for candidate in candidates:
            if candidate.casefold() in taken:
                continue
            try:
                (self.folder / candidate).mkdir()
            except FileExistsError:
                continue
            except OSError as error:
                raise StorageError(
                    f"{self.folder / candidate} can't be made: {error.strerror or error}"
                ) from error
            return self.folder / candidate
        return None

    def list(self) -> list[dict[str, object]]:
        """Return what is known of each recording, the newest first, those that were deleted as well."""
        entries = [
            {"name": folder.name, **asdict(about_in(folder)), "deleted": folder.parent == self._trash}
            for place in (self.folder, self._trash)
            for folder in self._entries(place)
            if _file(folder, RECORDING) is not None
        ]
        return sorted(entries, key=lambda each: (str(each["created"]), str(each["name"])), reverse=True)

    def folders(self) -> Iterator[Path]:
        """Return the folders of all recordings that weren't deleted."""
        return self._entries(self.folder)

    def folder_of(self, name: object) -> Path:
        """Return the folder of a recording that wasn't deleted; raises `UsageError`, `UnknownName` where there is none."""
        return self._in(self.folder, name)

    def file(self, name: object, which: str) -> Path:
        """Return a file of a recording; raises as `folder_of`, and `UnknownName` where it has no such file."""
        folder = self.folder_of(name)
        path = _file(folder, which)
        if path is None:
            raise UnknownName(f"file of {folder.name}", which, [])
        return path

    def with_names(self, sentence: str) -> str:
        """Return a sentence with recordings' names in the place of their files' paths, which don't belong on a page."""
        within = re.escape(os.path.join(self.folder, ""))
        short = re.sub(
            rf"{within}({_NAME.pattern}){re.escape(os.sep)}{re.escape(RECORDING)}", r"\1", sentence
        )
        return re.sub(rf"{within}(?={_NAME.pattern}{re.escape(os.sep)})", "", short)

    def note(self, name: object, notes: object) -> None:
        """Keep notes with a recording; raises `UsageError` for what is no text, or too long."""
        if not isinstance(notes, str) or len(notes) > _LONGEST_NOTES:
            raise UsageError(f"notes must be a text of at most {_LONGEST_NOTES} characters")
        self._revise(self.folder_of(name), notes=notes)

    def judge(self, folder: Path, result: Mapping[str, Any]) -> None:
        """Keep what was identified from the recording in a folder; raises `StorageError`."""
        replace_file(folder / RESULT, json.dumps(result, indent=2, allow_nan=False) + "\n")
        self._revise(folder, verdict=str(result["verdict"]))

    def result(self, name: object) -> dict[str, Any] | None:
        """Return what was identified from a recording, None if nothing was since the user said what its columns are.

        Raises as `folder_of`, and `FormatError` for a file that somebody has spoilt.
        """
        folder = self.folder_of(name)
        path = _file(folder, RESULT)
        if path is None or not about_in(folder).verdict:
            return None
        try:
            result = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise FormatError(f"{path} can't be read: {error}; identify {folder.name} again") from error
        if not isinstance(result, dict):
            raise FormatError(f"{path} holds no result; identify {folder.name} again")
        return result

    def say_columns(self, folder: Path, mapping: str, length: float, samples: int) -> None:
        """Keep which columns of the recording in a folder are what, as TOML; raises `StorageError`."""
        replace_file(folder / MAPPING, mapping)
        self._revise(folder, columns="said", duration=length, samples=samples, verdict="")

    def _revise(self, folder: Path, **known: Any) -> None:
        with self._noting:
            keep_about(folder, replace(about_in(folder), **known))

    def delete(self, name: object) -> None:
        """Move a recording away, so that `undelete` can bring it back."""
        self._move(self.folder_of(name), self._trash)

    def undelete(self, name: object) -> None:
        """Bring a deleted recording back."""
        self._move(self._in(self._trash, name), self.folder)

    def forget(self, folder: Path) -> None:
        """Remove a folder that `new` made and nothing was recorded in."""
        shutil.rmtree(folder)

    def _in(self, place: Path, name: object) -> Path:
        wanted = check_name(name)
        for folder in self._entries(place):
            if folder.name == wanted:
                return folder
        raise UnknownName("recording", wanted, [folder.name for folder in self._entries(place)][:20])

    def _move(self, folder: Path, to: Path) -> None:
        if (to / folder.name).exists():
            raise UsageError(f"there is a recording called {folder.name!r} there already")
        try:
            folder.rename(to / folder.name)
        except OSError as error:
            raise StorageError(f"{folder} can't be moved: {error.strerror or error}") from error

    def _entries(self, place: Path) -> Iterator[Path]:
        """The folders in there that may be recordings."""
        try:
            entries = sorted(os.scandir(place), key=lambda each: each.name)
        except FileNotFoundError:
            return
        for entry in entries:
            if entry.is_dir(follow_symlinks=False) and _NAME.fullmatch(entry.name):
                yield place / entry.name


def about_in(folder: Path) -> About:
    """Return what is known of the recording in a folder; a damaged file says nothing."""
    path = _file(folder, ABOUT)
    if path is None:
        return About()
    try:
        entries = json.loads(path.read_text(encoding="utf-8"))
        known = {
            key: _as(type(value), entries[key]) for key, value in asdict(About()).items() if key in entries
        }
    except (OSError, ValueError, TypeError, RecursionError):
        return About(notes="(about.json can't be read)")
    return About(**known)


def _as(kind: type[Any], value: Any) -> Any:
    """A value from about.json in its type; raises `ValueError`, `TypeError` if it hasn't that type."""
    if kind is not tuple:
        return kind(value)
    if not isinstance(value, list) or not all(isinstance(each, str) for each in value):
        raise TypeError("expected a list of sentences")
    return tuple(value)


def keep_about(folder: Path, about: About) -> None:
    """Write what is known of a recording, all of it or nothing; raises `StorageError`."""
    replace_file(folder / ABOUT, json.dumps(asdict(about), ensure_ascii=False, indent=2) + "\n")


def replace_file(path: Path, text: str) -> None:
    """Write a text file whole, in the place of an earlier one, or leave that as it is; raises `StorageError`."""
    try:
        with NamedTemporaryFile("w", encoding="utf-8", dir=path.parent, prefix=".", delete=False) as file:
            file.write(text)
        os.replace(file.name, path)
    except OSError as error:
        raise StorageError(f"{path} can't be written: {error.strerror or error}") from error


def _file(folder: Path, name: str) -> Path | None:
    """A file in a folder; None where there is none, or a link stands in its place."""
    path = folder / name
    return path if path.is_file() and not path.is_symlink() else None


def _times() -> Iterator[str]:
    """Names after the time, that of a second recording in the same second with a number."""
    name = f"run-{datetime.now():%Y%m%d-%H%M%S}"
    yield name
    for again in range(2, 1000):
        yield f"{name}-{again}"
