"""Recordings to write and read: a small one by hand, and any at all by hypothesis."""

from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

from servobench.core.channels import Channel, DeviceInfo
from servobench.core.finding import Finding, Severity, info
from servobench.recordings.native.writer import Together
from servobench.recordings.recording import Event, Recording, Series, Source, Stopped


def series(name: str, values: list[float], t: list[float] | None) -> Series:
    """Return a series in volts."""
    times = None if t is None else np.array(t, dtype=np.float64)
    return Series(channel=Channel(name=name, unit="V"), values=np.array(values, dtype=np.float64), t=times)


TOGETHER = [Together(channels=("applied", "counts")), Together(channels=("notes",), timed=False)]


def opening(name: str = "run") -> Recording:
    """Return what is known of `small` before its first sample."""
    full = small(name)
    nothing = np.empty(0)
    return replace(
        full,
        events=(),
        series=tuple(
            replace(each, values=nothing, t=None if each.t is None else nothing) for each in full.series
        ),
    )


def small(name: str = "run", samples: int = 3) -> Recording:
    """Return a recording with two channels that share their times, and one without times."""
    t = [0.002 * k for k in range(samples)]
    return Recording(
        name=name,
        series=(
            series("applied", [1.0 + k for k in range(samples)], t),
            series("counts", [7.0 * k for k in range(samples)], t),
            series("notes", [np.nan, -1.0], None),
        ),
        source=Source(name="twin"),
        input="applied",
        output="counts",
        input_before=0.0,
        chain="lowpass 50 rad/s",
        info=DeviceInfo(name="twin", channels=(Channel(name="counts", unit="counts", counter_bits=24),)),
        experiment='[signal]\ntype = "square"\n',
        findings=(info("example", "an example"),),
        stopped=Stopped(reason="finished", sentence="ran for 6 ms, as asked"),
        versions={"servobench": "0"},
        events=(
            Event(tick=0, time=0.0, kind="opened", text='{"info": {}}'),
            Event(tick=1, time=0.002, kind="command", text='{"number": 1}'),
        ),
    )


numbers = st.floats(allow_nan=True, allow_infinity=True)
limits = st.none() | st.floats(allow_nan=False)
words = st.text(max_size=8)  # any characters, lone surrogates among them, as in the names of files

channels = st.builds(
    Channel,
    name=words,
    unit=st.none() | words,
    minimum=limits,
    maximum=limits,
    resolution=limits,
    counter_bits=st.none() | st.integers(1, 64),
    counts_per_rev=limits,
)
findings = st.builds(
    Finding,
    code=words,
    severity=st.sampled_from(Severity),
    sentence=words,
    parameters=st.lists(words, max_size=2).map(tuple),
    rows=st.none() | st.tuples(st.integers(1, 9), st.integers(1, 9)),
)
infos = st.builds(
    DeviceInfo,
    name=words,
    serial=words,
    channels=st.lists(channels, max_size=2).map(tuple),
    delay=st.floats(allow_nan=False),
    timing=st.sampled_from(["virtual", "host", "device"]),
    settings=st.lists(st.tuples(words, words), max_size=2).map(tuple),
)


events = st.builds(
    Event,
    tick=st.integers(-(2**63), 2**63 - 1),
    time=st.floats(allow_nan=False),
    kind=words,
    text=words,
)


@st.composite
def recordings(draw: st.DrawFn) -> Recording:
    """Any recording: groups of channels that share times, with NaN, infinities, no times or no samples at all."""
    names = draw(st.lists(words, max_size=5, unique=True))
    all_series: list[Series] = []
    while len(all_series) < len(names):
        count = draw(st.integers(0, 5))
        values = st.lists(numbers, min_size=count, max_size=count)
        t = draw(st.none() | values)
        for _ in range(draw(st.integers(1, 3))):
            if len(all_series) < len(names):
                channel = replace(draw(channels), name=names[len(all_series)])
                times = None if t is None else np.array(t, dtype=np.float64)
                all_series.append(
                    Series(channel=channel, values=np.array(draw(values), dtype=np.float64), t=times)
                )
    role = st.none() | st.sampled_from(names) if names else st.none()
    return Recording(
        name=draw(words),
        series=tuple(draw(st.permutations(all_series))),
        source=draw(st.builds(Source, name=words, sha256=words, format=words)),
        input=draw(role),
        output=draw(role),
        input_before=draw(st.none() | st.floats(allow_nan=False)),
        chain=draw(words),
        info=draw(st.none() | infos),
        experiment=draw(words),
        findings=tuple(draw(st.lists(findings, max_size=2))),
        stopped=draw(
            st.builds(Stopped, reason=st.sampled_from(["finished", "interrupted", "unknown"]), sentence=words)
        ),
        versions=draw(st.dictionaries(words, words, max_size=2)),
        events=tuple(draw(st.lists(events, max_size=2))),
    )
