"""The power amplifier between the commanded voltage and the winding."""

from __future__ import annotations

from servobench.core.settings import Resistance, Settings, Voltage


class Amplifier(Settings):
    """A voltage amplifier: it saturates at ±limit, loses its dead band, and has a resistance in series with the winding.

    By definition v = 0 for |u| <= dead_band, otherwise sgn(u) (min(|u|, limit) - dead_band).
    """

    limit: Voltage = 10.0
    """Largest voltage it puts out, either way [V]."""
    dead_band: Voltage = 0.0
    """Voltage lost before the motor sees any [V]."""
    resistance: Resistance = 0.0
    """Output resistance, in series with the winding [Ω]."""

    def saturate(self, command: float) -> float:
        """Return the command within ±limit [V], which is what an amplifier can tell of itself."""
        return max(-self.limit, min(self.limit, command))

    def output(self, command: float) -> float:
        """Return the voltage at the winding's end of the amplifier [V], before its series resistance."""
        v = self.saturate(command)
        return 0.0 if abs(v) <= self.dead_band else v - self.dead_band if v > 0 else v + self.dead_band
