"""The bump test as a laboratory sheet has it: the speed behind 50/(s + 50), steady levels by eye, τ where 63.2 % is reached."""

import math

import numpy as np
from record import Answer, NoAnswer, Record
from scipy.signal import lfilter

CUTOFF = 50.0  # rad/s
HELD = 1.0  # s: a level must be held for so long to count as steady
STEADY = 0.25  # s: the end of a level, over which it is averaged


def bump(record: Record) -> Answer:
    c = math.exp(-CUTOFF * record.sample_time)
    y = lfilter([1.0 - c], [1.0, -c], record.speed)
    u = record.u[1:]
    edges = np.concatenate([[0], np.flatnonzero(np.diff(u)) + 1, [len(u)]])
    held, steady = round(HELD / record.sample_time), round(STEADY / record.sample_time)
    gains, lags = [], []
    for before, at, after in zip(edges[:-2], edges[1:-1], edges[2:], strict=True):
        if min(at - before, after - at) < held or u[at] < u[before]:
            continue
        low, high = y[at - steady : at].mean(), y[after - steady : after].mean()
        reached = np.flatnonzero(y[at:after] >= low + (1.0 - math.exp(-1.0)) * (high - low))
        gains.append((high - low) / (u[at] - u[at - 1]))
        lags.append(reached[0] * record.sample_time)
    if not gains:
        raise NoAnswer("no step up between two levels that are held long enough")
    return Answer(gain=float(np.mean(gains)), time_constant=float(np.mean(lags)))


METHODS = {"bump test by hand, 63.2 %": bump}
