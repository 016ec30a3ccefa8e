"""The efficiency of srivc against the Cramér-Rao bound on the benchmark of Rao and Garnier, and the time of a fit.

    G(s) = (-6400 s + 1600) / (s⁴ + 5 s³ + 408 s² + 416 s + 1600)

Two pairs of poles, at 20 and at 2 rad/s, with damping 0.1 and 0.25, and a zero in the right half-plane (Rao and Garnier, 2002).
The input is a binary sequence of 10 stages, each bit held for 7 samples of 10 ms (7161 samples a period); the noise is white,
10 dB below the output. The fit starts from nothing. The bound counts all unknowns: six coefficients, four start states and
the output at no input.
"""

import statistics
import sys
import time
from dataclasses import replace

import numpy as np
from figures import Figure, shown

from servobench.identification.estimators.base import ESTIMATORS
from servobench.identification.models.base import STRUCTURES
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Source
from servobench.systems.signals.prbs import PRBS

STAGES, CLOCK, SAMPLE_TIME = 10, 7, 0.01
TRUTH = {"a1": 5.0, "a2": 408.0, "a3": 416.0, "a4": 1600.0, "b0": -6400.0, "b1": 1600.0}
RUNS = 200
FAILED = 10.0  # bounds away from the truth: no chance, but another minimum


def input_data(samples: int) -> Dataset:
    """Return the first samples of the benchmark's input, with an output of zero."""
    t = np.arange(samples) * SAMPLE_TIME
    sequence = PRBS(low=-1.0, high=1.0, bit_time=CLOCK * SAMPLE_TIME, order=STAGES, seed=2**STAGES - 1)
    source = Source(name="Rao-Garnier")
    # Half a sample later, or the rounding of a time would decide on the bit at its edge.
    u = sequence(t + 0.5 * SAMPLE_TIME)
    return Dataset(
        name="Rao-Garnier", t_input=t, u=u, input_unit="V", input_before=0.0,
        t_output=t, y=np.zeros(samples), output_unit="rad/s", kind="speed", source=source,
    )  # fmt: skip


def figures(samples: int, *, at_most: float | None, runs: int = RUNS) -> list[Figure]:
    """Return the figures for a record of so many samples; the limit is that of the errors over the bound."""
    structure, srivc, data = STRUCTURES["rational_4_1"], ESTIMATORS["srivc"], input_data(samples)
    theta = np.concatenate([list(TRUTH.values()), np.zeros(len(structure.nuisance(data)))])
    exact = structure.predict(theta, data)
    noise = float(np.sqrt(np.mean(exact.y**2) / 10))
    bound = noise * np.sqrt(np.diag(np.linalg.inv(exact.jacobian.T @ exact.jacobian)))[: len(TRUTH)]
    errors, covered, seconds, lost = [], [], [], 0
    srivc.fit(structure, [replace(data, y=exact.y)])  # compiles
    for seed in range(runs):
        record = replace(data, y=exact.y + noise * np.random.default_rng(seed).standard_normal(samples))
        start = time.process_time()
        fit = srivc.fit(structure, [record])
        seconds.append(time.process_time() - start)
        errors.append((fit.model.theta - theta[: len(TRUTH)]) / bound)
        lost += not fit.converged or bool(np.abs(errors[-1]).max() > FAILED)
        covered.append(
            [low <= v <= high for (low, high), v in zip(intervals(fit), TRUTH.values(), strict=True)]
        )
    rms, share = np.sqrt(np.mean(np.square(errors), axis=0)), np.mean(covered, axis=0)
    what = f"srivc, Rao-Garnier, N = {samples}"
    found = [
        Figure(
            what=f"{what}: RMSE of {name} over its bound", value=float(value), unit="times", at_most=at_most
        )
        for name, value in zip(TRUTH, rms, strict=True)
    ]
    low, middle, high = (1e3 * quartile for quartile in statistics.quantiles(seconds, n=4))
    return [
        *found,
        Figure(what=f"{what}: failures in {runs} runs", value=float(lost), unit="runs", at_most=0.0),
        Figure(what=f"{what}: least coverage of a 95 % interval", value=100 * float(share.min()), unit="%"),
        Figure(what=f"{what}: largest coverage", value=100 * float(share.max()), unit="%"),
        Figure(what=f"{what}: a fit, processor time", value=middle, half=(low, high), unit="ms"),
    ]  # fmt: skip


def intervals(fit):
    return [fit[name].interval for name in TRUTH]


def main() -> list[Figure]:
    """Return the figures of this bench."""
    period = (2**STAGES - 1) * CLOCK
    return [*figures(period, at_most=1.1), *figures(1000, at_most=None)]


def smallest() -> list[Figure]:
    """Return the figures of two runs of the short record."""
    return figures(1000, at_most=None, runs=2)


if __name__ == "__main__":
    sys.exit(shown(main()))
