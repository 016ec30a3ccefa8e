"""The verb `load`, which reads foreign files in a child process."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from servobench.recordings.formats.base import FORMATS, read_here
from servobench.recordings.formats.base import load as load_with
from servobench.recordings.loading.reader_process import the_reader
from servobench.recordings.recording import Recording


def load(path: str | os.PathLike[str]) -> tuple[Recording, ...]:
    """Return the recordings in a file of any known format.

    The ending of the name and the content decide the format; if they disagree, the content counts, and a
    finding says so. The recording's `source` is the file: its name as given, its SHA-256 and the format. A
    library reads files that aren't plain text, in a child process with limits on memory and time, which is
    kept for the next file; in a browser, which has no processes, it reads them in this one. Raises
    `UsageError` if there is no such file, `FormatError` if it can't be read.

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder) / "log.csv"
    ...     _ = file.write_text("t,u,angle\\n0,0,0\\n0.1,2,1\\n0.2,2,4\\n")
    ...     (recording,) = load(file)
    >>> recording["angle"].values
    array([0., 1., 4.])
    """
    return load_with(path, read=_read)


def load_two_columns(path: str | os.PathLike[str]) -> tuple[Recording, ...]:
    """Return the recordings in a text file whose rows, such as `7,25`, are two whole numbers, and not one with a decimal comma.

    Raises what `load` does.
    """
    from servobench.recordings.formats.csv import Csv

    return load_with(path, read=lambda _, file: Csv(separator=",", decimal=".").read(file))


def _read(format: str, file: Path) -> tuple[Recording, ...]:
    in_child = FORMATS[format].by_library and sys.platform != "emscripten"  # a browser has no processes
    return the_reader().read(format, file) if in_child else read_here(format, file)
