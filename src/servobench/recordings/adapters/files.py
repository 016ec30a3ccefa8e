"""Files: a path, as text or as `pathlib.Path`."""

from __future__ import annotations

import os
from typing import Any, ClassVar, final

from servobench.recordings.adapters.base import ADAPTERS
from servobench.recordings.loading.load import load
from servobench.recordings.recording import Recording


@final
@ADAPTERS.member("files")
class Files:
    """A file of any format that is known, by its path."""

    accepted: ClassVar[str] = "a file's path"

    def accepts(self, data: object) -> bool:
        """Return whether it is a path."""
        return isinstance(data, str | os.PathLike)

    def recordings(self, data: Any) -> tuple[Recording, ...]:
        """Return the recordings in the file; raises what `load` does."""
        return load(data)
