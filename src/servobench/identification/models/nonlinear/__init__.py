"""The nonlinear motor: a ladder of friction terms, and gravity."""

from servobench.identification.models.nonlinear.grammar import ladder as ladder
from servobench.identification.models.nonlinear.structure import NonlinearMotor as NonlinearMotor
