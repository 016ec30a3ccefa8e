"""Results that reports are written of, and the experiment behind one of them."""

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.channels import Channel, DeviceInfo
from servobench.identification.identify import identify
from servobench.identification.result import Result
from servobench.recordings.recording import Recording, Series, Source, Stopped
from tests.report.makers import QUANTUM, dataset

HOSTILE = "<script>alert('x')</script> & $\\frac{1}{2}$ \u4e2d\n\udcff"
"""A name that nobody should give to a recording, but that somebody will."""

EXPERIMENT = """
[experiment]
name = "paper"
duration = "3 s"
sample_time = "0.002 s"
seed = 0

[signal]
type = "square"
low = "1 V"
high = "3 V"
"""


@pytest.fixture(scope="session")
def good() -> Result:
    """A result from an encoder, beside a data sheet."""
    return identify(dataset(), nominal="qube_servo_2")


@pytest.fixture(scope="session")
def several() -> Result:
    """A result from eight noisy records, two more than a figure holds, the first of them with a hostile name."""
    names = [HOSTILE, *(f"test {n}" for n in range(2, 9))]
    return identify([dataset(samples=400, name=name, seed=n, noise=4.0) for n, name in enumerate(names)])


@pytest.fixture(scope="session")
def refused() -> Result:
    """A result from an input that never changes, which no model can be had from."""
    data = dataset(level=1.0)
    return identify(replace(data, u=np.zeros_like(data.u), input_before=0.0))


@pytest.fixture(scope="session")
def run() -> Recording:
    """The recording that a run would have left of the good result's data, seven samples of it late."""
    data = dataset()
    late = (data.t_output > 2.985).astype(float)
    series = {
        Channel(name="commanded", unit="V"): data.u,
        Channel(name="applied", unit="V"): data.u,
        Channel(name="counts", unit="counts", counts_per_rev=2048.0, counter_bits=24): data.y / QUANTUM - 0.5,
        Channel(name="scheduled", unit="s"): data.t_output - 0.0004 * late,
        Channel(name="late", unit="1"): late,
    }
    return Recording(
        name="run",
        series=tuple(Series(channel=c, values=v, t=data.t_output) for c, v in series.items()),
        source=Source(name="twin"),
        input="applied",
        output="counts",
        input_before=0.0,
        info=DeviceInfo(name="twin", serial="simulated", settings=(("motor", "qube_servo_2"),)),
        experiment=EXPERIMENT,
        stopped=Stopped(reason="finished", sentence="ran for 3 s, as asked"),
        versions={"servobench": "0.1.0", "numpy": "2.4.6"},
    )


@pytest.fixture(scope="session")
def timed(run: Recording) -> Recording:
    """The same by the computer's clock rather than in virtual time."""
    return replace(run, info=DeviceInfo(name="board", timing="host"))


@pytest.fixture(scope="session")
def file(run: Recording) -> Recording:
    """The same as a file of somebody else's."""
    source = Source(name="my data.csv", sha256="ab" * 32, format="csv")
    return replace(run, name="my data", source=source, info=None, experiment="", versions={})
