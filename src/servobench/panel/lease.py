"""The operator's lease: one page drives at a time, all others watch."""

from __future__ import annotations

from servobench.core.errors import UsageError
from servobench.panel.viewers import Viewer


class Refusal(UsageError):
    """The request can't be carried out now, or not for this page; the message says why."""


class Lease:
    """The right to drive, which one viewer has at a time; `operator` is that one, or None."""

    def __init__(self) -> None:
        self.operator: Viewer | None = None

    @property
    def taken(self) -> bool:
        """Whether a live page drives; a hidden or frozen one doesn't keep others from driving."""
        return self.operator is not None and self.operator.attention.there

    def take(self, viewer: Viewer) -> None:
        """Make a viewer the operator; raises `Refusal` for one that may only watch, and where another one is and shows itself."""
        if viewer.role != "operator":
            raise Refusal("this page may watch, and stop the motor; it can't drive it")
        if self.taken and self.operator is not viewer:
            raise Refusal("another page drives the motor; it must release it first")
        self.operator = viewer
        viewer.attention.begin()

    def check(self, viewer: Viewer) -> None:
        """Raise `Refusal` for all but the operator."""
        if self.operator is not viewer:
            raise Refusal("this page doesn't drive the motor: take control first")

    def end(self) -> None:
        """End the lease: there is no operator any more."""
        self.operator = None
