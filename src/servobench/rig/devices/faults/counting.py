"""The encoder's counter, and how far it has moved."""

from __future__ import annotations

from servobench.core.channels import DeviceInfo


def counter_bits(info: DeviceInfo) -> int | None:
    """Return the width at which a device's counter wraps; None where it doesn't."""
    counts = info.channel("counts")
    return counts.counter_bits if counts else None


def wrap_count(count: int, bits: int | None) -> int:
    """Return what a signed counter of that width shows for a count; one without a width shows the count."""
    if bits is None:
        return count
    half = 1 << (bits - 1)
    return (count + half) % (2 * half) - half


class Travel:
    """The count without wraps, from what a counter shows sample by sample; right below half its range in a step."""

    def __init__(self, bits: int | None) -> None:
        self._bits = bits
        self._shown: int | None = None
        self.count = 0

    def went(self, shown: int) -> int:
        """Take what the counter shows; returns how far it went since the sample before, 0 at the first."""
        step = 0 if self._shown is None else wrap_count(shown - self._shown, self._bits)
        self.count = shown if self._shown is None else self.count + step
        self._shown = shown
        return step
