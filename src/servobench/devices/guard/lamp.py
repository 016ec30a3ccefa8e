"""A device's light, by which a guard shows whether the motor is at rest, driven, or has failed."""

from __future__ import annotations

from servobench.devices.base import Device, Lit
from servobench.experiment.limits import LIGHTS, Light


class Lamp:
    """The light of a device, written only where it changes; nothing happens where the device has none."""

    def __init__(self, device: Device) -> None:
        self._device = device if isinstance(device, Lit) else None
        self.shown: Light | None = None

    def show(self, light: Light) -> None:
        """Show a light; raises what the device raises."""
        if light != self.shown and self._device is not None:
            self._device.light(*LIGHTS[light])
        self.shown = light

    def show_if_it_can(self, light: Light) -> None:
        """Show a light where the motor is being stopped: a lamp that fails is no reason not to."""
        try:
            self.show(light)
        except OSError:  # what a device that is lost raises
            self.shown = None
