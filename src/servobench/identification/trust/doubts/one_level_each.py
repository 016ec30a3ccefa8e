"""Records of one level each that together show more friction than motors have: one may have another unit, or another motor."""

from __future__ import annotations

import numpy as np

from servobench.core.finding import Finding, warning
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import plain
from servobench.identification.estimators.base import Fit
from servobench.identification.models.level import has_one_level_each
from servobench.identification.trust.doubts.base import DOUBTS, Doubt

_MUCH = 0.3  # of the largest input
_MOST = 3  # records: among more the one that doesn't belong to the others is found
_KNOWN = 3.0  # standard deviations from zero


def _about_fit(fit: Fit) -> list[Finding]:
    records = [record.data for record in fit.records]
    if "coulomb_voltage" not in fit.model.names or len(records) > _MOST or not has_one_level_each(records):
        return []
    friction = fit["coulomb_voltage"]
    share = abs(friction.value) / max(float(np.abs(record.u).max()) for record in records)
    if share < _MUCH or abs(friction.value) < _KNOWN * friction.sd:
        return []
    name = parameter_in_words("coulomb_voltage", friction.unit)
    sentence = (
        f"Each record has one level of the input, so gain and {name} are what makes these {len(records)} agree, and that takes "
        f"{plain(100 * share, 2)} % of the largest input for friction, more than nearly all motors have. Check that all records "
        "are of one motor and in one unit; a record with several levels would show it."
    )
    return [warning("one-level-each", sentence, parameters=("gain", "coulomb_voltage"))]


DOUBTS.member("one_level_each")(Doubt(codes=("one-level-each",), about_fit=_about_fit))
