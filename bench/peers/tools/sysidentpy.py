"""SysIdentPy: its polynomial model of degree one, y(k) = c + a y(k-1) + b₁ u(k-1) + b₂ u(k-2), by FROLS and least squares."""

from record import Answer, Array, answer_of, both_ways
from sysidentpy.basis_function import Polynomial
from sysidentpy.model_structure_selection import FROLS
from sysidentpy.parameter_estimation import LeastSquares

CONSTANT, OUTPUT, INPUT = 0, 1001, (2001, 2002)  # its names for c, y(k-1), u(k-1) and u(k-2)


def frols(u: Array, y: Array, sample_time: float) -> Answer:
    model = FROLS(
        order_selection=False,
        n_terms=4,
        xlag=2,
        ylag=1,
        basis_function=Polynomial(degree=1),
        estimator=LeastSquares(),
    )
    model.fit(X=u.reshape(-1, 1), y=y.reshape(-1, 1))
    value = {int(code[0]): float(x) for code, x in zip(model.final_model, model.theta.ravel(), strict=True)}
    pole = value.get(OUTPUT, 0.0)
    return answer_of(pole, sum(value.get(code, 0.0) for code in INPUT) / (1.0 - pole), sample_time)


METHODS = both_ways("sysidentpy FROLS, linear", frols)
