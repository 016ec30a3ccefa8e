"""The study `why_claimed`: why a claimed figure differs from the exercise's recording."""

from __future__ import annotations

from typing import TYPE_CHECKING

from servobench.core.errors import NotIdentifiable
from servobench.identification.reconciliation.claim import Claim
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table

if TYPE_CHECKING:
    from servobench.identification.reconciliation.explanation import Explanation


@STUDIES.member("why_claimed")
class WhyClaimed(StudySettings):
    """A claimed gain or time constant: what several methods read off the same recording, and which cause would explain it.

    A cause's probability is that of taking part, alone or with another one, as the verb `why` weighs it.
    """

    claim: str = "tau=0.13"
    """The claim, as `servobench why` takes it."""
    sheet: str = "qube_servo_2"
    """The data sheet that tells what is known of the motor, so that causes have sizes in Ω and kg·m²."""
    method: str = ""
    """The method behind the claimed figure, if known, such as `step_63`."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the tables of readings and of causes; raises `NotIdentifiable` where the recording tells nothing of it."""
        from servobench.identification.identify import identify
        from servobench.identification.why import why
        from servobench.recordings.measurement.measure import measure

        claim = Claim.parse(self.claim)
        explanation = why(
            identify(measure(stand.recording)), [claim], nominal=self.sheet, method=self.method or None
        )
        if not explanation.differences:
            raise NotIdentifiable(" ".join(explanation.sentences))
        return StudyResult(
            tables=(_readings(explanation), _causes(explanation)), sentences=explanation.sentences
        )


def _readings(explanation: Explanation) -> Table:
    from servobench.identification.reconciliation.reenactment import SPOKEN

    readings = explanation.readings
    return Table(
        title="The same recording, read by others",
        columns=(
            Column(name="reading", heading="read by", values=tuple(SPOKEN[each.method] for each in readings)),
            Column(name="chain", heading="behind", values=tuple(each.chain for each in readings)),
            Column(
                name="gain",
                heading="K",
                unit="rad/(s·V)",
                values=tuple(each.gain for each in readings),
            ),
            Column(
                name="time_constant",
                heading="τ",
                unit="s",
                values=tuple(each.time_constant for each in readings),
            ),
        ),
    )


def _causes(explanation: Explanation) -> Table:
    causes = explanation.causes
    return Table(
        title="What could have made the difference",
        columns=(
            Column(name="cause", heading="cause", values=tuple(each.label for each in causes)),
            Column(
                name="probability",
                heading="probability",
                unit="%",
                digits=2,
                values=tuple(100 * each.probability if each.possible else "—" for each in causes),
            ),
            Column(
                name="needed",
                heading="all of it would take",
                values=tuple(each.needed.text if each.needed else "—" for each in causes),
            ),
            Column(
                name="against", heading="against it", values=tuple(each.against or "—" for each in causes)
            ),
        ),
        note="Causes may act together, so their probabilities may add up to more than 100 %.",
    )
