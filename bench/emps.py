"""A real axis, EMPS (Janot, Gautier and Brunot 2019): four parameters beside the published ones, and honest intervals?

    python bench/run.py emps

The recordings are other people's and no part of this project: `DATA_EMPS.mat` and `DATA_EMPS_PULSES.mat` are looked for in the
folder `emps` of the one that SERVOBENCH_REAL_DATA names. The input of the second record holds the pulses that were added to it.
"""

import os
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from figures import Figure, shown
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.estimators.least_squares import lowest
from servobench.identification.estimators.output_error import simulate_record
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES
from servobench.recordings.formats.base import load
from servobench.recordings.formats.mapping import assign
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.measure import measure

FOLDER = Path(__file__).resolve().parent.parent.parent / "shared" / "data"
STRUCTURE = STRUCTURES["first_order_coulomb"]
NAMES = [parameter.name for parameter in STRUCTURE.parameters]
COUNTS = ((4, False), (5, True), (6, True))  # segments, and whether their scatter is compared with a limit
JUDGED = ("gain", "time_constant", "coulomb_voltage")

# With start states fitted, as here, they come out a little better than in the publication (3.52 % over the training record).
# M 95.1089 kg, Fv 203.5034 N·s/m, Fc 20.3935 N, offset -3.1648 N, drive gain 35.15065 N/V.
PUBLISHED = {
    "gain": 35.15065 / 203.5034,
    "time_constant": 95.1089 / 203.5034,
    "coulomb_voltage": 20.3935 / 35.15065,
    "offset_voltage": -3.1648 / 35.15065,
    "delay": 0.0,
}


def main(counts: Sequence[tuple[int, bool]] = COUNTS, share: float = 1.0) -> list[Figure]:
    """Return the figures of both records, of so large a share of each; one without a number where the recordings are absent."""
    folder = Path(os.environ.get("SERVOBENCH_REAL_DATA") or FOLDER) / "emps"
    if not folder.is_dir():
        what = "EMPS: not run, the recordings are absent (SERVOBENCH_REAL_DATA names their folder)"
        return [Figure(what=what, value=float("nan"))]
    whole = [record(folder / name) for name in ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat")]
    training, pulses = (data.part(0.0, share * data.duration) if share < 1 else data for data in whole)
    return [*_predictions(training, pulses), *_scatters((training, pulses), counts)]


def record(path: Path) -> Dataset:
    """Return a record: the controller's voltage, and the position that was measured."""
    return measure(assign(load(path)[0], input="vir:V", output="qm:m"))


def four_parameters(data: Dataset) -> Array:
    """Return gain, time constant, Coulomb voltage, offset and a delay of zero, by output error."""
    starts = [np.where(_is_delay(guess), 0.0, guess) for guess in STRUCTURE.guesses([data])]
    found = lowest(STRUCTURE, [data], starts, ~_is_delay(starts[0]))
    return found.theta[: len(NAMES)]


def _is_delay(theta: Array) -> NDArray[np.bool_]:
    found = np.zeros(len(theta), dtype=bool)
    found[NAMES.index("delay")] = True
    return found


def relative_error(found: FittedRecord) -> float:
    """Return 100 |q - q̂| / |q| [%]."""
    return 100 * float(np.linalg.norm(found.residual) / np.linalg.norm(found.data.y))


def _predictions(training: Dataset, pulses: Dataset) -> list[Figure]:
    published = np.array([PUBLISHED[name] for name in NAMES])
    own = four_parameters(training)
    old = [relative_error(simulate_record(STRUCTURE, published, data)) for data in (training, pulses)]
    new = [relative_error(simulate_record(STRUCTURE, own, data)) for data in (training, pulses)]
    named = "EMPS, position simulated from voltage, relative error over the"
    return [
        Figure(what=f"{named} training record, published parameters", value=old[0], unit="%"),
        Figure(what=f"{named} training record, four parameters", value=new[0], unit="%", at_most=1.65),
        Figure(what=f"{named} record with pulses, published parameters", value=old[1], unit="%"),
        Figure(what=f"{named} record with pulses, the same four", value=new[1], unit="%", at_most=old[1]),
    ]


def segments(data: Dataset, count: int) -> list[Dataset]:
    """Return so many parts of equal length.

    The axis goes up and down in 6.24 s, four times. Of five or six parts each has another part of the way, and at least a
    quarter of its time in each direction. Four parts are four times the same way: there the friction's dependence on place and
    speed comes back each time, and the scatter tells how well a measurement repeats, not how near the truth it is.
    """
    length = data.duration / count
    return [data.part(k * length, (k + 1) * length) for k in range(count)]


def scatter(fits: Sequence[Fit]) -> dict[str, float]:
    """Return the standard deviation of the estimates over the root mean square of the stated ones."""
    out = {}
    for name in JUDGED:
        values, sds = np.array([_estimate(fit, name) for fit in fits]).T
        out[name] = float(np.std(values, ddof=1) / np.sqrt(np.mean(sds**2)))
    return out


def _estimate(fit: Fit, name: str) -> tuple[float, float]:
    """The value and standard deviation; where friction isn't the same in both directions, of the mean of the two."""
    wanted = [name] if name in fit.model.names else [f"{name}_forward", f"{name}_backward"]
    weights = np.array([each in wanted for each in fit.model.names]) / len(wanted)
    return float(weights @ fit.model.theta), float(np.sqrt(weights @ fit.covariance @ weights))


def _scatters(records: Sequence[Dataset], counts: Sequence[tuple[int, bool]]) -> list[Figure]:
    """The scatter over disjoint segments beside what is stated, the two records pooled."""
    figures = []
    for count, judged in counts:
        found = [scatter([_fitted(part) for part in segments(data, count)]) for data in records]
        for name in JUDGED:
            each = [ratios[name] for ratios in found]
            figures.append(
                Figure(
                    what=f"EMPS, scatter of the {name.replace('_', ' ')} over {count} segments, two records",
                    value=float(np.sqrt(np.mean(np.square(each)))),
                    unit="stated sd",
                    at_most=1.5 if judged else None,
                    at_least=1 / 1.5 if judged else None,
                )
            )
    return figures


def _fitted(data: Dataset) -> Fit:
    fit = identify(data).fit
    if fit is None:
        raise ValueError(f"{data.name}: nothing was identified")
    return fit


def smallest() -> list[Figure]:
    """Return the same figures from two segments of the first way up and down."""
    return main(((2, False),), share=0.25)


if __name__ == "__main__":
    sys.exit(shown(main()))
