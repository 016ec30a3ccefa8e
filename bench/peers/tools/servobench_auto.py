"""servobench itself: `identify` with everything left to it, which fits a delay and chooses structure and estimator."""

from record import QUANTUM, Answer, NoAnswer, Record

import servobench as sb
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Source


def auto(record: Record) -> Answer:
    data = Dataset(
        name="record",
        t_input=record.t,
        u=record.u,
        input_unit="V",
        input_before=float(record.u[0]),
        t_output=record.t,
        y=record.position,
        output_unit="rad",
        kind="position",
        source=Source(name="record"),
        quantum=QUANTUM,
    )
    result = sb.identify(data)
    if result.fit is None:
        raise NoAnswer("; ".join(finding.sentence for finding in result.findings))
    gain, tau = result.fit["gain"], result.fit["time_constant"]
    return Answer(
        gain=gain.value,
        time_constant=tau.value,
        gain_interval=gain.interval,
        time_constant_interval=tau.interval,
        interval_from="tool",
        note=f"{result.verdict}, {result.fit.structure}, {result.fit.estimator}",
    )


METHODS = {"servobench identify (auto)": auto}
