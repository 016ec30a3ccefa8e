"""The paper's experiment in real time, while others keep the machine busy: is each sample accounted for, and the answer the same?

    python bench/paper_live.py            10 s, for `make bench`
    python bench/paper_live.py --full     60 s, the length that docs/benchmarks/realtime.md tells of

A square wave of 1 to 3 V at 0.4 Hz at 1 kHz on the simulated motor beside the wall clock, in the loop's own process, recorded,
while a process reads all rows without a pause and `stress-ng`, where it is installed, loads all processors. The same in virtual
time gives the figures that it is compared with.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from figures import Figure, shown
from realtime import SAMPLE_TIME, reading, stressed

QUICK, FULL = 10.0, 60.0
FAR = 3.3  # standard deviations; one of a thousand pairs that agree is further apart


def main(seconds: float = QUICK) -> list[Figure]:
    """Run it, and return what isn't accounted for and how far the answers are apart."""
    from servobench.identification.identify import identify
    from servobench.recordings.measurement.measure import measure
    from servobench.rig.devices.base import connect
    from servobench.rig.experiment import DeviceChoice, Experiment
    from servobench.rig.loop.process import LoopProcess
    from servobench.rig.loop.run import run
    from servobench.systems.signals.square import Square

    twin = DeviceChoice(name="twin", settings={"timing": "host"})
    asked = Experiment(
        signal=Square(low=1, high=3, frequency=0.4),
        duration=seconds,
        sample_time=SAMPLE_TIME,
        device=twin,
        limits={"watchdog": {"timeout": 0.5}},
    )
    with (
        tempfile.TemporaryDirectory() as folder,
        LoopProcess(asked, record=Path(folder) / "live.mcap") as loop,
        stressed(shutil.which("stress-ng") is not None),
        reading(loop.ring.name),
    ):
        live = loop.wait()
        written = loop.ring.written
    with connect("twin") as motor:
        virtual = run(asked, motor)
    told = _missed(live.findings)
    samples = len(live["counts"].values)
    ticks = round(seconds / SAMPLE_TIME)
    one, other = (identify(measure(recording)).fit for recording in (live, virtual))
    if one is None or other is None:
        raise RuntimeError("one of the two gave no model")
    late = 1e6 * (live["counts"].t - live["scheduled"].values)  # type: ignore[operator]
    print(
        f"{samples} samples, {told} missed, lateness p50 {np.median(late):.3g} us, p99 {np.quantile(late, 0.99):.3g} us"
    )
    figures = [
        Figure(what=f"paper's experiment live, {seconds:g} s, under load: ticks neither recorded nor told as missed",
               value=abs(ticks - samples - told), at_most=0),
        Figure(what="rows of the loop that aren't in the file", value=abs(written - samples), at_most=0),
    ]  # fmt: skip
    for name in ("gain", "time_constant"):
        apart = abs(one[name].value - other[name].value) / np.hypot(one[name].sd, other[name].sd)
        what = f"{name}: {one[name].value:.6g} live, {other[name].value:.6g} in virtual time; apart"
        figures.append(Figure(what=what, value=float(apart), unit="sd", at_most=FAR))
    return figures


def _missed(findings: tuple[object, ...]) -> int:
    """The number of missed samples by the recording's own findings."""
    return sum(
        int(each.sentence.split(" of ")[0])
        for each in findings
        if each.code == "samples-missed"  # type: ignore[attr-defined]
    )


def smallest() -> list[Figure]:
    """Return the figures of two seconds."""
    return main(2.0)


if __name__ == "__main__":
    sys.exit(shown(main(FULL if "--full" in sys.argv[1:] else QUICK)))
