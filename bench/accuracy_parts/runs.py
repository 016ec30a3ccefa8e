"""One run of a row, and what is kept of it."""

import time
from typing import Any

import numpy as np

from accuracy_parts.inputs import SAMPLE_TIME
from accuracy_parts.plants import QUANTUM, Case
from accuracy_parts.rows import Row
from servobench.core.errors import NotIdentifiable
from servobench.identification.identify import identify
from servobench.identification.result import Result
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Source

Run = dict[str, Any]


def dataset(case: Case) -> Dataset:
    """Return the record as what identification works on: a position in the middle of each count's quantum."""
    t = np.arange(len(case.u)) * SAMPLE_TIME
    return Dataset(
        name="simulated motor",
        t_input=t,
        u=case.u,
        input_unit="V",
        input_before=case.before,
        t_output=t,
        y=(case.counts + 0.5) * QUANTUM,
        output_unit="rad",
        kind="position",
        source=Source(name="simulated motor"),
        quantum=QUANTUM,
    )


def one_run(row: Row, number: int) -> Run:
    """Return what came of a run, as plain data: truth, bound, estimates, verdict, the codes of what was found."""
    case = row.plant.case(np.random.default_rng(row.base + number))
    kept: Run = {
        "run": number,
        "truth": {"gain": case.truth.gain, "time_constant": case.truth.time_constant, "delay": case.truth.delay},
        "bound": case.bound,
    }  # fmt: skip
    start = time.perf_counter()
    try:
        result = identify(dataset(case), estimator=row.estimator)
    except NotIdentifiable as error:
        return {**kept, "verdict": "refused", "error": str(error)}
    except Exception as error:  # a crash is a finding of this bench, not its end
        return {**kept, "verdict": "crashed", "error": f"{type(error).__name__}: {error}"}
    return {**kept, "seconds": round(time.perf_counter() - start, 4), **_answer(result)}


def _answer(result: Result) -> Run:
    fit = result.fit
    findings = {str(f.severity): [] for f in result.findings}
    for f in result.findings:
        findings[str(f.severity)].append(f.code)
    kept: Run = {"verdict": str(result.verdict), "findings": findings}
    if fit is not None:
        kept |= {
            "structure": fit.structure,
            "estimator": fit.estimator,
            "residual_roundings": fit.residual_sd / (QUANTUM / np.sqrt(12)),
            "estimates": {name: [e.value, e.sd, *e.interval] for name, e in fit.estimates.items()},
        }
    return kept
