"""The motor with what isn't linear in it: a friction ladder and gravity."""

from servobench.identification.models.nonlinear.grammar import ladder as ladder
from servobench.identification.models.nonlinear.structure import NonlinearMotor as NonlinearMotor
