"""The study `restarts`: what the counter shows at the start of one run after the other."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from servobench.lab.required_facts import required_fact
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table


@STUDIES.member("restarts")
class Restarts(StudySettings):
    """The exercise's experiment several times in a row: the counter at the first and at the last sample of each run."""

    runs: Annotated[int, Field(ge=2, le=5)] = 2
    """The number of runs, including the exercise's own."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table of first and last counts."""
        recordings = (
            stand.recording,
            *(stand.run(stand.experiment) for _ in range(self.runs - 1)),
        )
        counts = [recording["counts"].values for recording in recordings]
        per_rev = required_fact(stand, "counts_per_rev")
        last = tuple(float(each[-1]) for each in counts)
        return StudyResult(
            tables=(
                Table(
                    title="The same experiment, restarted",
                    columns=(
                        Column(name="run", heading="run", values=tuple(range(1, self.runs + 1))),
                        Column(
                            name="first",
                            heading="counter at the start",
                            values=tuple(float(each[0]) for each in counts),
                            unit="counts",
                        ),
                        Column(
                            name="last", heading="counter at the end", values=last, unit="counts", digits=7
                        ),
                        Column(
                            name="angle",
                            heading="the end as an angle",
                            values=tuple(2 * math.pi * each / per_rev for each in last),
                            unit="rad",
                        ),
                    ),
                    note="The end of one run is the zero of the next: an incremental encoder has no absolute zero.",
                ),
            )
        )
