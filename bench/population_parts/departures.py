"""Modest departures of a motor from its model, each with what is true of the parameters then."""

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Departure:
    """By how much a motor departs from a first-order one with Coulomb friction; zero is not at all.

    Shares: `stribeck` of the Coulomb voltage more at rest, `cogging` and `dead_band` of the amplitude, `sag` and `warming` of
    the resistance, `winding` L/R of the time constant, `jitter` of the sample time. `play` and `eccentricity` in rad.
    The rest is drawn: at what speed the excess at rest has fallen to 37 % [rad/s], teeth, phases, voltages [V].
    """

    name: str = "none"
    stribeck: float = 0.0
    cogging: float = 0.0
    play: float = 0.0
    dead_band: float = 0.0
    sag: float = 0.0
    warming: float = 0.0
    eccentricity: float = 0.0
    jitter: float = 0.0
    winding: float = 0.0
    slow: float = 1.0
    teeth: int = 1
    phase: float = 0.0
    amplitude: float = 1.0

    @property
    def is_marched(self) -> bool:
        """Whether the motor's equation is another one, so that it is simulated in short steps."""
        return any((self.stribeck, self.cogging, self.sag, self.warming, self.winding))

    def output_fits(self, name: str) -> bool:
        """Whether such an output shows the departure: a sensor of speed on the motor's own shaft knows no play."""
        return name != "speed" or not self.play

    def coulomb_share(self, share: float) -> float:
        """The share of the Coulomb voltage in the amplitude: excess friction at rest needs friction."""
        return max(share, 0.05) if self.stribeck else share

    def drawn(self, random: np.random.Generator, amplitude: float, gain: float) -> "Departure":
        """Return the same with what chance decides."""
        if self.name == "none":
            return self
        return replace(
            self,
            slow=gain * amplitude * random.uniform(0.01, 0.1),
            teeth=int(random.integers(3, 25)),
            phase=random.uniform(0.0, 2 * np.pi),
            amplitude=amplitude,
        )

    def gains(self, gain: float, coulomb: float, one_size: bool) -> tuple[float, float]:
        """Return the lowest and the highest gain that is right: that between two voltages, where no other can be told.

        A dead band under voltages of one size is a lower gain. Behind a sagging supply ω = K (u - u_c (1 + s (u/A)²)), whose
        slope between two voltages is lower by at most 2 s u_c/A.
        """
        lower = self.dead_band * one_size + 2.0 * self.sag * coulomb / self.amplitude
        return gain * (1.0 - lower), gain

    def true(self, tau: float, delay: float, coulomb: float) -> dict[str, tuple[float, float]]:
        """Return what is true of time constant, delay, their sum and Coulomb voltage, each from lowest to highest.

        Where a resistance or a friction changes within the record any value that it had is right, and so is the straight line
        through what friction costs at two voltages where it grows with them. Two poles are a slow one and a delay by the fast
        one's time constant.
        """
        rise = 1.0 + self.sag + self.warming
        slow, late = tau, delay
        if self.winding:
            # τ τ_e s² + τ s + 1 = 0
            root = np.sqrt(1.0 - 4.0 * self.winding)
            slow, late = 0.5 * tau * (1.0 + root), delay + 0.5 * tau * (1.0 - root)
        lag = slow + late
        return {
            "time_constant": (slow, slow * rise),
            "delay": (late, late),
            "lag": (lag, lag + slow * (rise - 1.0)),
            "coulomb_voltage": (
                coulomb * (1.0 - self.sag),
                (coulomb + self.dead_band * self.amplitude) * rise * (1.0 + self.stribeck),
            ),
        }


NONE = Departure()

DEPARTURES = {
    departure.name: departure
    for departure in (
        Departure(name="stribeck", stribeck=0.3),
        Departure(name="cogging", cogging=0.005),
        Departure(name="play", play=float(np.deg2rad(0.2))),
        Departure(name="dead-band", dead_band=0.03),
        Departure(name="sag", sag=0.05),
        Departure(name="warming", warming=0.05),
        Departure(name="eccentricity", eccentricity=0.005),
        Departure(name="jitter", jitter=0.05),
        Departure(name="winding", winding=0.05),
    )
}
