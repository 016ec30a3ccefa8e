"""The verb why: from data and a claimed figure to the cause of the difference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Unpack

from servobench.core.arguments import check_type
from servobench.core.errors import UsageError
from servobench.identification.identify import identify
from servobench.identification.reconciliation.claim import Claim
from servobench.identification.reconciliation.explanation import Explanation
from servobench.identification.reconciliation.reconcile import explain
from servobench.identification.result import Result
from servobench.recordings.reading import ReadingOptions
from servobench.rig.motor.parameters import MotorParameters


def why(
    data: object = None,
    claims: str | Sequence[Claim | str] | Mapping[str, float] = (),
    *,
    nominal: str | MotorParameters | None = None,
    method: str | None = None,
    starts_at_rest: bool = False,
    **options: Unpack[ReadingOptions],
) -> Explanation:
    """Return why claimed figures, or those of a data sheet, differ from those that the data give.

    `data` is a `Result`, or data for `identify`, read in the same way. `claims` are texts such as "tau=0.13"
    or "gain=23.8", or a mapping of such values; without any, the data sheet `nominal` is explained. `method`
    is how the claim was found, if known: see `explain`, also for the value returned. Raises `UsageError` if
    there is nothing to explain, and what `identify` and `explain` raise.

    >>> import servobench as sb
    >>> with sb.connect("twin") as motor:
    ...     recording = sb.run(sb.Experiment(duration="3 s"), motor)
    >>> found = sb.why(recording, "tau=0.13")
    >>> found.causes[0].label
    'measurement lag'
    """
    check_type("starts_at_rest", starts_at_rest, bool, "True or False")
    if isinstance(data, Result):
        if options:
            raise UsageError(f"data is a Result already: leave {', '.join(options)} out")
        result = data
    else:
        result = identify(data, starts_at_rest=starts_at_rest, **options)
    texts = (claims,) if isinstance(claims, str) else claims
    return explain(result, texts, nominal=nominal, method=method)
