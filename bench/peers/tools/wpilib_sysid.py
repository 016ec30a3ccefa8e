"""The regression of WPILib's SysId, written again from its documentation: a voltage is k_S sgn(v) + k_V v + k_A a.

The speed goes through a median of five, the acceleration is the difference over two samples, and least squares gives
the acceleration from speed, voltage and direction; K = 1/k_V, τ = k_A/k_V.
It isn't WPILib's program, nor its protocol of four tests.
"""

import numpy as np
from record import Answer, Record
from scipy.signal import medfilt

STILL = 0.5  # rad/s: slower samples are trimmed, as the program does below its threshold of motion


def regression(record: Record) -> Answer:
    speed = medfilt(record.speed, 5)
    acceleration = (speed[2:] - speed[:-2]) / (2.0 * record.sample_time)
    v, u = speed[1:-1], record.u[2:-1]
    moves = np.abs(v) > STILL
    rows = np.column_stack([v, u, np.sign(v)])[moves]
    by_speed, by_voltage, _ = np.linalg.lstsq(rows, acceleration[moves], rcond=None)[0]
    return Answer(gain=float(-by_voltage / by_speed), time_constant=float(-1.0 / by_speed))


METHODS = {"WPILib SysId regression (written again)": regression}
