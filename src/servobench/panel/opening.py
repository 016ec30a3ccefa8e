"""A device that is being opened, which takes seconds, or minutes the first time, when kernels are compiled."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

LOOP = "starting the loop and the device"
LIVE = "preparing live identification"
_STEPS = (LOOP, LIVE)


@dataclass
class Opening:
    """The device that is being opened, and what it is doing now, in words; `since` is a monotonic time [s]."""

    device: str
    doing: str = LOOP
    since: float = field(default_factory=time.monotonic)

    def state(self) -> dict[str, Any]:
        """Return how far it is, as the pages see it: the step, of how many, and for how many seconds it has gone on."""
        return {
            "device": self.device,
            "doing": self.doing,
            "step": _STEPS.index(self.doing) + 1,
            "of": len(_STEPS),
            "seconds": time.monotonic() - self.since,
        }
