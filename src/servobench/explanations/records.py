"""Records, or parts of one, in which the motor isn't the same."""

from __future__ import annotations

import numpy as np

from servobench.explanations.base import EXPLANATIONS, Case, Explained
from servobench.finding import warning

_APART = 0.02  # of the gain: records of one motor differ by less


def _records(case: Case) -> Explained | None:
    """Whether the records hold to the equation with a gain each, and not with a common one."""
    if len(case.motions) < 2:
        return None
    columns = []
    for k in range(1, len(case.motions)):
        for make in (1, 2):
            columns.append(
                [each.base[0][:, make] * (1.0 if n == k else 0.0) for n, each in enumerate(case.motions)]
            )
    found = case.with_columns(*columns)
    first = found.coefficients[1]
    gains = np.array([first, *(first + found.coefficients[5 + 2 * k] for k in range(len(case.motions) - 1))])
    middle = float(np.median(gains))
    if middle == 0 or float(np.abs(gains / middle - 1).max()) < _APART:
        return None
    far = int(np.argmax(np.abs(gains - middle))) if len(gains) > 2 else int(np.argmax(np.abs(gains)))
    sentence = (
        f"The records disagree: by itself {case.motions[far].data.name} has "
        f"{gains[far] / np.median(np.delete(gains, far)):.3g} times the gain of the others. They are of different motors or "
        "gears, or one has another supply, unit or label. Fit them one by one."
    )
    return Explained(
        finding=warning("records-disagree", sentence, parameters=("gain",)), misfit=found.misfit, chosen=1
    )


def _changes(case: Case) -> Explained | None:
    """Whether the gain or the friction changes steadily through the record."""
    gone = [2 * (each.t - each.t[0]) / (each.t[-1] - each.t[0]) - 1 for each in case.motions]
    by_gain = [each.caused(each.u * g) for each, g in zip(case.motions, gone, strict=True)]
    by_friction = [each.caused(each.sense * g) for each, g in zip(case.motions, gone, strict=True)]
    found = case.with_columns(by_gain, by_friction)
    added = np.column_stack([np.concatenate(by_gain), np.concatenate(by_friction)]) @ found.coefficients[5:]
    share = 2 * np.sqrt(3 * np.sum(added**2) / case.plain.total)  # from end to end, what changes evenly
    sentence = (
        f"The motor answered differently at the end of the record than at its beginning, by about {100 * share:.2g} % of its "
        "speed: the supply sagged, the motor warmed up, or its friction changed. What was found is a mean over the record."
    )
    return Explained(
        finding=warning("motor-changes", sentence, parameters=("gain", "time_constant")),
        misfit=found.misfit,
        chosen=2,
    )


EXPLANATIONS.member("records")(_records)
EXPLANATIONS.member("changes")(_changes)
