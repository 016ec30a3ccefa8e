"""A device's light, by which a guard shows whether the motor is at rest, driven, or has failed."""

from __future__ import annotations

from collections.abc import Callable

from servobench.rig.devices.base import Device
from servobench.rig.experiment.limits import LIGHTS, Light


class Lamp:
    """The light of a device that is `Lit`, written only where it changes; nothing happens where the device has none."""

    def __init__(self, device: Device) -> None:
        # Asked for by its name: a device around another one may hand on what it hasn't itself, which a Protocol doesn't see.
        self._light: Callable[[float, float, float], None] | None = getattr(device, "light", None)
        self.shown: Light | None = None

    def show(self, light: Light) -> None:
        """Show a light; raises what the device raises."""
        if light != self.shown and self._light is not None:
            self._light(*LIGHTS[light])
        self.shown = light

    def show_if_it_can(self, light: Light) -> None:
        """Show a light where the motor is being stopped: a lamp that fails is no reason not to."""
        try:
            self.show(light)
        except OSError:  # what a device that is lost raises
            self.shown = None
