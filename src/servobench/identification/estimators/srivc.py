"""Simplified refined instrumental variables for continuous-time models: rational transfer functions of any order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.core.finding import Finding, refusal, warning
from servobench.identification.estimators.base import ESTIMATORS, Abilities, Fit, hindrance
from servobench.identification.estimators.least_squares import lowest
from servobench.identification.estimators.output_error import fit_minimum
from servobench.identification.models.base import Structure
from servobench.identification.models.rational import Rational
from servobench.recordings.measurement.dataset import Dataset


class Srivc:
    """Regression with the filter 1/A of the model at hand, and its noise-free output as the instrument, until both agree.

    The iteration needs no start values (`models.rational.refined`). Its instruments are exact, so it rests where the squared
    simulation error is least; a few steps of Gauss and Newton finish it and bring in the delay. The estimate is then that of
    `output_error`, efficient for white noise, and so are its standard deviations. In a closed loop the noise comes back through
    the input, and the estimate is biased where the noise is coloured.

    Young and Jakeman, Int. J. Control 31 (1980) 741; Garnier and Wang (eds.), Identification of Continuous-time Models from
    Sampled Data, 2008, chapter 4. They let the filtered instrument be linear between samples; here it is exact.
    """

    abilities = Abilities(
        method=(
            "regression with refined instruments and filters, then Gauss-Newton with the delay; needs no "
            "start values"
        ),
        noise="white measurement noise; in open loop also unbiased for coloured noise",
        interval="covers; allows for coloured residuals",
        position=True,
        speed=True,
        chain=True,
        irregular_times=True,
        several_records=True,
        closed_loop=False,
        delay=True,
        friction=False,
        disturbance=False,
    )

    def supports(self, structure: Structure, data: Sequence[Dataset]) -> Finding | None:
        """Return a refusal for a structure that isn't a rational transfer function, None otherwise."""
        return hindrance("srivc", self.abilities, structure, data) or not_rational("srivc", structure)

    def fit(
        self, structure: Structure, data: Sequence[Dataset], starts: Sequence[Array] | None = None
    ) -> Fit:
        """Return the best fit, from refined instrumental variables or from start vectors; raises `NotIdentifiable`."""
        lacking = self.supports(structure, data)
        if lacking is not None:
            raise NotIdentifiable(lacking.sentence.rstrip("."))
        fit = fit_minimum(structure, data, lowest(structure, data, starts or structure.guesses(data)))
        return replace(fit, estimator="srivc", findings=(*fit.findings, *_in_a_loop(data)))


ESTIMATORS.member("srivc")(Srivc())


def not_rational(name: str, structure: Structure) -> Finding | None:
    """Return a refusal for a structure that isn't a rational transfer function."""
    if isinstance(structure, Rational):
        return None
    names = ", ".join(parameter.name for parameter in structure.parameters)
    return refusal(
        "estimator-unsuited",
        f"{name} fits rational structures only (rational_2_1, rational_1_0_integrator_delay), and this one has "
        f"{names}; output_error can fit it.",
    )


def _in_a_loop(data: Sequence[Dataset]) -> list[Finding]:
    if all(record.reference is None for record in data):
        return []
    return [
        warning(
            "loop-closed",
            "The data have a reference, so the loop was closed and coloured noise biases srivc. Use clsrivc.",
        )
    ]
