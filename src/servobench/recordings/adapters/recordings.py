"""Recordings, as they are."""

from __future__ import annotations

from typing import Any, ClassVar, final

from servobench.recordings.adapters.base import ADAPTERS
from servobench.recordings.recording import Recording


@final
@ADAPTERS.member("recordings")
class Recordings:
    """A `Recording`, such as `load` and `run` give."""

    accepted: ClassVar[str] = "a Recording"

    def accepts(self, data: object) -> bool:
        """Return whether it is a recording."""
        return isinstance(data, Recording)

    def recordings(self, data: Any) -> tuple[Recording, ...]:
        """Return it."""
        return (data,)
