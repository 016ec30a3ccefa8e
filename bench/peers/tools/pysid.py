"""pysid: ARX, ARMAX and output error with one pole and two numerator terms.

It stores the covariance of the discrete parameters; gain, time constant and their intervals are worked out from it by hand, to
first order.
"""

import numpy as np
from pysid import armax, arx, oe
from record import Answer, Array, NoAnswer, both_ways, interval, time_constant_of


def fit_arx(u: Array, y: Array, sample_time: float) -> Answer:
    model = arx(1, 1, 1, u.reshape(-1, 1), y.reshape(-1, 1))
    a, b = model.A[0, 0][1], model.B[0, 0][1:]
    return _answer(float(a), b, model.P, (0, 1, 2), sample_time)


def fit_armax(u: Array, y: Array, sample_time: float) -> Answer:
    model = armax(1, 1, 1, 1, u.reshape(-1, 1), y.reshape(-1, 1))
    a, b = model.A[0, 0][1], model.B[0, 0][1:]
    return _answer(float(a), b, model.P, (0, 1, 2), sample_time)


def fit_oe(u: Array, y: Array, sample_time: float) -> Answer:
    model = oe(1, 1, 1, u.reshape(-1, 1), y.reshape(-1, 1))
    f, b = model.F[0, 0][1], model.B[0, 0][1:]
    return _answer(float(f), b, model.P, (2, 0, 1), sample_time)


def _answer(f: float, b: Array, covariance: Array, order: tuple[int, int, int], sample_time: float) -> Answer:
    """The answer for (b₁ z⁻¹ + b₂ z⁻²)/(1 + f z⁻¹); `order` is where f, b₁ and b₂ stand in the covariance."""
    if len(b) != 2:
        raise NoAnswer(f"{len(b)} numerator terms in place of two")
    gain, tau = float(np.sum(b)) / (1.0 + f), time_constant_of(complex(-f), sample_time)
    by_gain = np.array([-gain, 1.0, 1.0]) / (1.0 + f)
    by_tau = np.array([-(tau**2) / (sample_time * -f), 0.0, 0.0])
    own = covariance[np.ix_(order, order)]
    sd = [float(np.sqrt(by @ own @ by)) for by in (by_gain, by_tau)]
    return Answer(
        gain=gain,
        time_constant=tau,
        gain_interval=interval(gain, sd[0]),
        time_constant_interval=interval(tau, sd[1]),
        interval_from="hand",
    )


METHODS = {
    **both_ways("pysid ARX(1,1,1)", fit_arx),
    **both_ways("pysid OE(1,1,1)", fit_oe),
    **both_ways("pysid ARMAX(1,1,1,1)", fit_armax),
}
