"""Time responses of python-control."""

from __future__ import annotations

import sys
from typing import Any, ClassVar, final

import numpy as np

from servobench.core.channels import Channel
from servobench.core.errors import UsageError
from servobench.recordings.adapters.base import ADAPTERS
from servobench.recordings.recording import Recording, Series, Source


@final
@ADAPTERS.member("responses")
class Responses:
    """A `control.TimeResponseData` of one input and one output; it has times but no units."""

    accepted: ClassVar[str] = "a TimeResponseData of python-control"

    def accepts(self, data: object) -> bool:
        """Return whether it is a time response, without importing python-control."""
        control = sys.modules.get("control")
        return control is not None and isinstance(data, control.TimeResponseData)

    def recordings(self, data: Any) -> tuple[Recording, ...]:
        """Return it as a recording; raises `UsageError` for several inputs or outputs, or none."""
        if data.ninputs != 1 or data.noutputs != 1 or data.ntraces > 1:
            raise UsageError(
                f"the time response has {data.ninputs} inputs, {data.noutputs} outputs and {data.ntraces} traces; expected one "
                "of each: take one, as in response[0, 0]"
            )
        t = np.asarray(data.time, dtype=np.float64)
        name = data.sysname or "response"
        labels = (*(data.input_labels or ["u"]), *(data.output_labels or ["y"]))
        series = tuple(
            Series(
                channel=Channel(name=label, unit=None),
                values=np.asarray(values, dtype=np.float64).ravel(),
                t=t,
            )
            for label, values in zip(labels, (data.inputs, data.outputs), strict=True)
        )
        source = Source(name=name, format="control")
        return (Recording(name=name, series=series, source=source, input=labels[0], output=labels[1]),)
