"""A brake: eddy currents, a fan or a tight bearing, whose drag in proportion to the speed is as large as the motor's own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from servobench.identification.reconciliation.base import CAUSES, Question, Sizes
from servobench.identification.reconciliation.causes.viscous_friction import ViscousFriction

_SIZES = (0.2, 20.0)  # of R b/k²: from where bearings end to a brake that leaves a twentieth of the speed


@dataclass(frozen=True)
class Brake(ViscousFriction):
    """Viscous friction beyond that of bearings, such as an eddy-current brake: the same law, with sizes spread evenly in ln ξ."""

    label: str = "a brake"
    law: str = "A brake (eddy currents, a fan) lowers gain and time constant together, by the same factor."
    occurrence: float = 0.05
    not_with: tuple[str, ...] = ("viscous_friction",)

    def domain(self, question: Question) -> tuple[float, float]:
        """The sizes that there are: less is a bearing's."""
        return _SIZES

    def sizes(self, question: Question) -> Sizes:
        """Even in ln ξ: the strength of a brake is unknown."""
        values = np.geomspace(*_SIZES, 81)
        steps = values * np.log(values[1] / values[0])
        return Sizes(values=values, weights=np.full(len(values), 1 / len(values)), steps=steps)


CAUSES.member("brake")(Brake())
