"""The rows of the table: a plant, what it is called, and what to do with its data."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from zlib import crc32

from accuracy_parts.inputs import INPUTS
from accuracy_parts.plants import (
    RISES,
    Backlash,
    Friction,
    Inductance,
    Plant,
    Reference,
    Ripple,
    Stribeck,
    TwoMass,
    Warming,
)

LIMIT = "At the bound"
KNOWN = "Friction near its threshold"
OUTSIDE = "Plants outside every structure"
_SHORT = {"square ±2 V": "square", "PRBS ±3 V": "prbs", "square 1-3 V": "one_way"}


@dataclass(frozen=True, kw_only=True)
class Row:
    """One row: its name, the table it belongs to, what it is in words, the plant, and the estimator asked for.

    Rows with the same `draws` meet the same data, run by run.
    """

    name: str
    part: str
    words: str
    plant: Plant
    estimator: str = "auto"
    draws: str = ""

    @property
    def base(self) -> int:
        """The seed of run 0; that of run n is n more."""
        return crc32((self.draws or self.name).encode()) * 1_000_000


def rows() -> tuple[Row, ...]:
    """Return all rows."""
    return (*_noises(), *_delays(), *_threshold(), *_outside())


def _noises() -> list[Row]:
    """The reference motor under each kind of noise, compared with the bound."""
    torques = {"1e-7": 1e-7, "1e-6": 1e-6, "1e-5": 1e-5, "1e-4": 1e-4}
    fine = partial(Row, part=LIMIT, draws="fine_noise")
    return [
        Row(name="encoder", part=LIMIT, words="encoder only", plant=Reference()),
        Row(name="encoder_noise", part=LIMIT, words="encoder, 0.3 count of noise", plant=Reference(noise=0.3)),
        *(
            Row(name=f"torque_{size}", part=LIMIT, words=f"torque {size} N·m/√Hz", plant=Reference(torque=torque))
            for size, torque in torques.items()
        ),
        fine(
            name="fine_noise",
            words="0.05 count of noise, output error",
            plant=Reference(noise=0.05),
            estimator="output_error",
        ),
        fine(
            name="fine_noise_interval",
            words="0.05 count of noise, interval likelihood",
            plant=Reference(noise=0.05, interval=True),
            estimator="interval_likelihood",
        ),
    ]  # fmt: skip


def _delays() -> list[Row]:
    """Delays that aren't known, turning one way, and turning both ways with friction."""
    return [
        *(
            Row(name=f"delay_{d:g}", part=LIMIT, words=f"delay of {d:g} samples", plant=Reference(delay=d))
            for d in (0.3, 1.0, 2.0)
        ),
        *(
            Row(
                name=f"coulomb_delay_{d:g}",
                part=LIMIT,
                words=f"Coulomb 0.3 V with reversals, delay of {d:g} samples",
                plant=Friction(0.3, "PRBS ±3 V", d),
            )
            for d in (0.0, 0.3, 1.0, 2.0)
        ),
    ]


def _threshold() -> list[Row]:
    """Friction that can hardly be told, and friction that can."""
    makers = [
        (f"friction_{volt:g}", f"Coulomb {volt:g} V", partial(Friction, volt))
        for volt in (0.001, 0.003, 0.01, 0.03, 0.1)
    ]
    return [row for maker in makers for row in _with_each_input(KNOWN, *maker)]


def _outside() -> list[Row]:
    """The rows whose motor no structure describes."""
    makers: list[tuple[str, str, Callable[[str], Plant]]] = [
        *((f"ripple_{100 * s:g}", f"ripple {100 * s:g} % of stall torque", partial(Ripple, s)) for s in (0.002, 0.01, 0.05)),
        *(
            (f"backlash_{at}_{gap:g}", f"backlash {gap:g} rad, encoder on the {at}", partial(Backlash, gap, at))
            for at in ("motor", "load")
            for gap in (0.01, 0.1)
        ),
        *((f"stribeck_{100 * x:g}", f"Stribeck, {100 * x:g} % more at rest", partial(Stribeck, x)) for x in (0.1, 0.3, 1.0)),
        *((f"warming_{rise}", f"resistance 10 % up, {rise}", partial(Warming, rise)) for rise in RISES),
        *(
            (f"two_mass_{hz}_{at}", f"two masses, {hz} Hz, encoder on the {at}", partial(TwoMass, hz, at))
            for at in ("motor", "load")
            for hz in (20, 60, 150)
        ),
        ("inductance", "L/R = 1 ms", partial(Inductance, 1e-3, 0.0)),
        ("inductance_coulomb", "L/R = 1 ms, Coulomb 0.16 V", partial(Inductance, 1e-3, 0.16)),
    ]  # fmt: skip
    return [row for maker in makers for row in _with_each_input(OUTSIDE, *maker)]


def _with_each_input(part: str, name: str, words: str, plant: Callable[[str], Plant]) -> list[Row]:
    return [
        Row(name=f"{name}_{_SHORT[drive]}", part=part, words=f"{words}, {drive}", plant=plant(drive))
        for drive in INPUTS
    ]
