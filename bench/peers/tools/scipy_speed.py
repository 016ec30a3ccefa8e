"""SciPy's `curve_fit` of a first-order response to the speed behind the customary filter 50/(s + 50).

The filter isn't in the model, as it isn't in those of most who fit this way.
"""

import math

import numpy as np
from record import Answer, Array, both_ways, interval
from scipy.optimize import curve_fit
from scipy.signal import lfilter

CUTOFF = 50.0  # rad/s


def filtered_fit(u: Array, y: Array, sample_time: float) -> Answer:
    c = math.exp(-CUTOFF * sample_time)
    filtered, _ = lfilter([1.0 - c], [1.0, -c], y, zi=[c * y[0]])

    def response(voltage: Array, gain: float, tau: float, start: float) -> Array:
        a = math.exp(-sample_time / abs(tau))
        forced = lfilter([0.0, gain * (1.0 - a)], [1.0, -a], voltage)
        return forced + start * a ** np.arange(len(voltage))

    guess = (float(filtered @ u) / float(u @ u), 0.05, float(filtered[0]))
    (gain, tau, _), covariance = curve_fit(response, u, filtered, p0=guess)
    sd = np.sqrt(np.diag(covariance))
    return Answer(
        gain=float(gain),
        time_constant=abs(float(tau)),
        gain_interval=interval(float(gain), float(sd[0])),
        time_constant_interval=interval(abs(float(tau)), float(sd[1])),
        interval_from="tool",
    )


METHODS = both_ways("scipy curve_fit on filtered speed", filtered_fit)
