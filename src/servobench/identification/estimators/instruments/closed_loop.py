"""A closed loop without its noise: the input that the reference alone would have caused.

Reference to output and reference to input have the same poles. The first is identified by refined instrumental variables; the
second is then linear regression on the reference filtered with those poles, and on the reference itself, which a controller may
pass on directly. The controller need not be known. If this model is inexact (a limit, a controller of a higher order), its
output still depends on the reference alone, which is all that an instrument needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from servobench.core.channels import Array
from servobench.identification.models.rational import Rational
from servobench.identification.models.rational.guesses import least_squares
from servobench.recordings.measurement.dataset import Dataset


def noise_free_inputs(
    structure: Rational, data: Sequence[Dataset], references: Sequence[Array]
) -> tuple[list[Array], float]:
    """Return the input (N,) of each record that its reference alone causes, and what share of the inputs' variance that is."""
    driven = [
        replace(record, reference=None, u=reference, input_before=float(reference[0]))
        for record, reference in zip(data, references, strict=True)
    ]
    loop, theta = _loop(structure, driven)
    blocks = []
    for record, measured in zip(driven, data, strict=True):
        own, shared = _columns(loop, theta, record)
        blocks.append((own, shared, measured.u))
    coefficients, private, cost = least_squares(blocks)
    inputs = [own @ x + shared @ coefficients for (own, shared, _), x in zip(blocks, private, strict=True)]
    total = sum(float(np.sum((record.u - record.u.mean()) ** 2)) for record in data)
    return inputs, 1.0 - cost / total if total > 0 else 0.0


def _loop(structure: Rational, driven: Sequence[Dataset]) -> tuple[Rational, Array]:
    """The structure from reference to output, and its parameters: one order above the motor, for an integrating controller."""
    order = structure.order + int(structure.integrator) + 1
    loop = Rational(order, order - 1)
    return loop, loop.guesses(driven)[0][: len(loop.parameters)]


def _columns(loop: Rational, theta: Array, driven: Dataset) -> tuple[Array, Array]:
    """A record's own columns (start state, a constant) and the shared ones (reference, filtered reference), at t_input.

    The reference acts on the input of the same instant; the filtered one is what it has done up to then.
    """
    at_input = replace(
        driven, t_output=driven.t_input, y=np.zeros(len(driven.u)), delay=0.0, current=None, rows=None
    )
    own = np.zeros(len(loop.nuisance(at_input)))
    lines = loop.lines(np.concatenate([theta, own]), at_input)
    before = np.concatenate([driven.u[:1], driven.u[:-1]])
    return (
        np.column_stack([lines.free, np.ones(len(driven.u))]),
        np.column_stack([driven.u, before, lines.forced]),
    )
