"""The study `inertias`: all that turns, body by body, and the time constant that each sum of them gives."""

from __future__ import annotations

import math
from typing import Annotated, Self, TypeAlias

from pydantic import Field, model_validator

from servobench.core.errors import UnknownName
from servobench.core.settings import In, Inertia, Settings
from servobench.lab.required_facts import required_fact
from servobench.lab.studies.base import STUDIES, Cell, Column, Stand, StudyResult, StudySettings, Table
from servobench.rig.motor.parameters import disc_inertia

Mass: TypeAlias = Annotated[float, In("kg"), Field(gt=0)]
Length: TypeAlias = Annotated[float, In("m"), Field(gt=0)]


class Body(Settings):
    """Something that turns: a disc of a mass and a radius, or anything of a known inertia."""

    name: Annotated[str, Field(min_length=1)]
    """The part's name."""
    mass: Mass | None = None
    """Mass [kg]."""
    radius: Length | None = None
    """Radius [m]."""
    inertia: Inertia | None = None
    """Inertia, where it is known without mass and radius [kg·m²]."""

    @model_validator(mode="after")
    def _check_inertia(self) -> Self:
        if (self.inertia is None) == (self.mass is None) or (self.mass is None) != (self.radius is None):
            raise ValueError("expected a mass and a radius, or else an inertia")
        return self

    @property
    def value(self) -> float:
        """J = m r²/2 of a homogeneous disc, or the inertia that was given [kg·m²]."""
        if self.inertia is not None:
            return self.inertia
        return disc_inertia(self.mass or math.nan, self.radius or math.nan)


class Total(Settings):
    """Bodies that are added up, by their names."""

    name: Annotated[str, Field(min_length=1)]
    """The sum's name."""
    of: Annotated[tuple[str, ...], Field(min_length=1)]
    """The names of the bodies."""


@STUDIES.member("inertias")
class Inertias(StudySettings):
    """J = m r²/2 of each disc, its share in the whole, and the time constant τ = R J/k² of each sum of bodies.

    The first is equation 6 of the paper; R and k are those of the experiment's data sheet.
    """

    bodies: Annotated[tuple[Body, ...], Field(min_length=1)]
    """The bodies that turn."""
    totals: tuple[Total, ...] = ()
    """Sums of bodies, a row each below them."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table; raises `UnknownName` for a sum over a body that isn't there."""
        values = {body.name: body.value for body in self.bodies}
        whole = math.fsum(values.values())
        rows = [
            *((body.name, body.mass, body.radius, body.value) for body in self.bodies),
            *((total.name, None, None, _sum(total, values)) for total in self.totals),
        ]
        scale = required_fact(stand, "sheet_resistance") / required_fact(stand, "sheet_motor_constant") ** 2
        inertias = tuple(row[3] for row in rows)
        table = Table(
            title="Everything that turns",
            columns=(
                Column(name="body", heading="", values=tuple(row[0] for row in rows)),
                Column(
                    name="mass", heading="mass", unit="kg", values=tuple(_or_none(row[1]) for row in rows)
                ),
                Column(
                    name="radius", heading="radius", unit="m", values=tuple(_or_none(row[2]) for row in rows)
                ),
                Column(
                    name="inertia", heading="J", unit="10⁻⁶ kg·m²", values=tuple(1e6 * j for j in inertias)
                ),
                Column(
                    name="share",
                    heading="share",
                    unit="%",
                    digits=3,
                    values=tuple(100 * j / whole for j in inertias),
                ),
                Column(
                    name="tau",
                    heading="τ = R·J/k²",
                    unit="s",
                    digits=3,
                    values=tuple(scale * j for j in inertias),
                ),
            ),
            note="Time constants add up as the inertias do: R and k are the same for all of them.",
        )
        return StudyResult(tables=(table,))


def _sum(total: Total, values: dict[str, float]) -> float:
    missing = next((name for name in total.of if name not in values), None)
    if missing is not None:
        raise UnknownName("body", missing, values)
    return math.fsum(values[name] for name in total.of)


def _or_none(value: float | None) -> Cell:
    return math.nan if value is None else value
