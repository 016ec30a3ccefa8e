"""Whose time a device's samples carry."""

from __future__ import annotations

from servobench.rig.devices.base import Device


def keeps_own_time(device: Device) -> str | None:
    """Return what keeps a device's time from going wrong, as the end of a sentence; None where it has a time of its own."""
    if device.info.timing == "host":
        return "its samples carry the host's time, which can't be changed"
    return None
