"""The columns of a foreign table: unit and time by their names, and their conversion to a recording."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array, Channel
from servobench.core.finding import Finding, info
from servobench.core.rounding import count_text
from servobench.core.units import is_unit, unit
from servobench.recordings.formats.epoch import epoch_unit
from servobench.recordings.formats.times import is_out_of_order, sorts_evenly, time_base, time_findings
from servobench.recordings.recording import Recording, Series, Source

Rows = NDArray[np.int64]

LARGEST_TABLE = 1000
"""The most columns that a table may have; what has more is an image or another matrix, not a set of channels."""

LARGEST_WHOLE = 2.0**53
"""From here on a float can't tell each whole number from the next."""

TIME_NAMES = frozenset(
    {"t", "time", "times", "timestamp", "timestamps", "time_stamp", "elapsed", "elapsed_time", "clock"}
    | {"sec", "secs", "seconds", "ms", "millis", "milliseconds", "us", "micros", "microseconds"}
    | {"ns", "nanos", "nanoseconds"}
    | {"zeit", "temps", "tempo", "tiempo"}
)
"""The names of a column of times, in lower case, once a unit is taken away."""

SECONDS_BY_CONVENTION = frozenset({"t", "time", "zeit", "temps", "tempo", "tiempo"})
"""The names that mean seconds unless another unit is given."""

# As in `time(t)`: no units.
_REMARKS_ON_TIME = frozenset({"t", "time", "elapsed", "relative", "local", "utc", "gmt"})
_LAST_WORDS = ("_time", "_timestamp")  # of a name that has a unit of time: `ros_time_s`

# A unit at the end of a name, as in `theta_deg`. Only what can hardly mean anything else; `_m` may stand for "measured".
_ENDINGS = {
    "ms": "ms", "us": "us", "sec": "s", "secs": "s", "seconds": "s",
    "millis": "ms", "milliseconds": "ms", "micros": "us", "microseconds": "us",
    "ns": "ns", "nanos": "ns", "nanoseconds": "ns",
    "deg": "deg", "degrees": "deg", "rad": "rad", "radians": "rad", "counts": "counts", "rpm": "rpm",
    "dps": "deg/s", "rps": "rev/s", "volt": "V", "volts": "V", "millivolts": "mV", "V": "V", "mV": "mV",
    "percent": "%", "pct": "%", "%": "%",
    "rad_s": "rad/s", "radps": "rad/s", "rad_per_s": "rad/s", "deg_s": "deg/s", "degps": "deg/s", "deg_per_s": "deg/s",
    "rev_s": "rev/s", "rev_per_s": "rev/s", "counts_s": "counts/s", "counts_per_s": "counts/s", "m_per_s": "m/s",
}  # fmt: skip
_ENDING = re.compile(
    rf"(?:^|.*_|.+\s(?=%))({'|'.join(sorted(_ENDINGS, key=len, reverse=True))})", re.IGNORECASE
)
# `current_A` is a current; `encoder_A` is the first of two tracks.
_CURRENT = re.compile(r"(?:.*_)?(?i:current|curr|i|ia|im|iq)_(A|mA)")
# `bus_voltage_v` is a voltage; `motor_v` may be a velocity, and `u_mv` a manipulated variable.
_VOLTAGE = re.compile(r"(?:.*_)?(?:voltage|emf|supply|battery|vbat|vbus|vin|volt)_(m?v)", re.IGNORECASE)
# `left_speed_ms` is in metres per second, and `speed_loop_ms` a time; `m_s` by itself is the mass of something.
_METRES = re.compile(
    r"(?:.*(?:speed|veloci|vitesse|geschwindigkeit).*|(?:.*_)?vel(?:_.*)?)_(ms|m_s|mps)", re.IGNORECASE
)
_DURATION = re.compile(
    r"time|stamp|period|delay|interval|duration|latency|loop|update|(?:^|_)(?:age|dt)(?:_|$)", re.IGNORECASE
)
# What stands in brackets and is no unit, as in `time(t)`, or in the underscores that a program puts in their place.
REMARK = re.compile(r"(?P<name>.+?)(?:\s*[\[({<](?P<inside>[^\[\](){}<>]+)[\])}>]|_(?P<between>[^_\W]+)_)")
_CLOSING = {"]": "[", ")": "(", "}": "{", ">": "<"}
_JOINED = re.compile(r"(?P<name>.+?)(?:\s*/\s*|\s+in\s+|\s*,\s*)(?P<unit>.+)")


@dataclass(frozen=True, kw_only=True)
class Heading:
    """A column's header: its name without the unit, and the unit's text, None where it has none.

    `from_name` says that the unit is no more than an ending of the name (`theta_deg`), which then keeps it.
    """

    name: str
    unit: str | None = None
    from_name: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Column:
    """A column of a table: what its header says (`heading`), and its values (N,) in that unit.

    `t` (N,) [s] are the column's own times, where the file has some for it alone. `is_time` says that the file's own type makes
    the values times, in s, whatever their name is.
    """

    heading: Heading
    values: Array
    t: Array | None = None
    is_time: bool = False


def heading(text: str) -> Heading:
    """Return what a header says: `omega [rad/s]`, `speed (deg/s)`, `u / V`, `y in rad`, `theta_deg` or a plain name.

    What stands in brackets and is no unit stays a part of the name.
    """
    text = printable(" ".join(text.split()))
    bracket = _bracket(text)
    if bracket is not None:
        name, inside = bracket
        if inside in {"-", "–", "1"}:
            return Heading(name=name, unit="1")
        symbol = _unit_of(inside)
        return Heading(name=text) if symbol is None else Heading(name=name, unit=symbol)
    joined = _JOINED.fullmatch(text)
    if joined and is_unit(joined["unit"]) and not is_unit(text):
        return Heading(name=joined["name"], unit=joined["unit"])
    return Heading(name=text, unit=(symbol := _unit_in_name(text)), from_name=symbol is not None)


def _unit_of(text: str) -> str | None:
    """The unit that a text is, also one that begins with a capital letter (`Milliseconds`); None where it is none.

    Nobody measures in megaseconds: `Ms` and `MS` are milliseconds. `Min` is the least of something.
    """
    if text in {"Ms", "MS"}:
        return "ms"
    if is_unit(text):
        return text
    small = text.lower()
    is_word = len(text) > 2 and text[1:] == small[1:] and text != "Min"
    return small if is_word and is_unit(small) else None


def with_unit(name: Heading, text: str) -> tuple[Heading, tuple[Finding, ...]]:
    """Return a heading with the unit that a file has for it beside its name; with a finding where that is no unit known here."""
    text = printable(" ".join(text.split()))
    if not text:
        return name, ()
    if text in {"-", "–"}:
        return Heading(name=name.name, unit="1"), ()
    if is_unit(text):
        return Heading(name=name.name, unit=text), ()
    sentence = (
        f"`{name.name}` is in {text[:40]!r} in the file, which isn't a known unit: give it as COL:UNIT."
    )
    return name, (info("unit-unknown", sentence),)


def _bracket(text: str) -> tuple[str, str] | None:
    """The text before and in the last pair of brackets, where it ends with one."""
    opening = _CLOSING.get(text[-1:])
    depth = 0
    for k in range(len(text) - 1, -1, -1):
        depth += (text[k] == text[-1]) - (text[k] == opening)
        if opening and depth == 0:
            return text[:k].strip(), text[k + 1 : -1].strip()
    return None


def _unit_in_name(name: str) -> str | None:
    if "/" in name and is_unit(name) and unit(name).quantity == "speed":
        return name
    if _is_in_metres(name):
        return "m/s"
    if current := _CURRENT.fullmatch(name):
        return current[1]
    if voltage := _VOLTAGE.fullmatch(name):
        return {"v": "V", "mv": "mV"}[voltage[1].lower()]
    remark = _remark_of_time(name)
    if remark and remark["between"] and _is_unit_of_time(remark["between"]):
        return remark["between"]  # `Time_ms_` was `Time (ms)` before a program put underscores in
    ending = _ENDING.fullmatch(name)
    if ending:
        symbol = ending[1]
        # `u_V` is a voltage; `u_v` may be anything.
        return _ENDINGS.get(symbol) if len(symbol) <= 2 else _ENDINGS.get(symbol.lower())
    # `t_s` is a time in seconds; `x_s` may be anything.
    return "s" if name.endswith("_s") and _is_time_word(name[:-2]) else None


def _is_in_metres(name: str) -> bool:
    """Whether a name is that of a speed and ends in metres per second, which is written like milliseconds."""
    return _METRES.fullmatch(name) is not None and _DURATION.search(name) is None


def _is_time_word(name: str) -> bool:
    return name.lower() in TIME_NAMES or name.lower().endswith(_LAST_WORDS)


def bare_name(name: str) -> str:
    """Return a name without a unit that it ends in: `theta` of `theta_deg`; a name that is a unit stays."""
    if _unit_in_name(name) is None:
        return name
    ending = (
        _CURRENT.fullmatch(name)
        or _VOLTAGE.fullmatch(name)
        or _METRES.fullmatch(name)
        or _ENDING.fullmatch(name)
    )
    return (name[: ending.start(1)] if ending else name.removesuffix("_s")).rstrip("_ ") or name


def distinct(names: Sequence[str]) -> tuple[tuple[str, ...], tuple[Finding, ...]]:
    """Return names that differ: an empty one is called after its column, a second `y` becomes `y_2`; with findings."""
    taken = set(names)
    counts: Counter[str] = Counter()
    result: list[str] = []
    renamed: list[str] = []
    empty: list[str] = []
    for number, name in enumerate(names, 1):
        counts[name] += 1
        if name and counts[name] == 1:
            result.append(name)
            continue
        new = f"column_{number}" if not name else f"{name}_{counts[name]}"
        while new in taken:
            new += "_"
        taken.add(new)
        result.append(new)
        (renamed if name else empty).append(new)
    findings = []
    if renamed:
        findings.append(
            info("name-duplicate", f"Some names occur twice; the later ones are called {quote(renamed)}.")
        )
    if empty:
        findings.append(info("name-missing", f"Some columns have no name; they are called {quote(empty)}."))
    return tuple(result), tuple(findings)


def quote(names: Iterable[str], most: int = 12) -> str:
    """Return names as a list for a sentence; what goes beyond `most` is only counted."""
    names = [printable(name) for name in names]
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(f"`{name}`" for name in names[:most]) + more


def printable(text: str) -> str:
    """Return a text of a file's without control characters and line ends: a name must not steer a terminal, or forge a line."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def recording_of(
    columns: Sequence[Column],
    *,
    name: str,
    source: Source,
    findings: Iterable[Finding] = (),
    rows: Rows | None = None,
) -> Recording:
    """Return the recording that a foreign table is: a channel for each column, in their order.

    A column without times of its own gets those of a time column of its length, where one is recognised beyond doubt; the time
    column stays as a channel. In names with dots (`motor.u`) the time column next to it comes first (`motor.t`), then one further
    up (`t`).
    `rows` (N,) are the rows of the file that the samples stand in, where those are not 1 to N.
    """
    names, name_findings = distinct([printable(column.heading.name) for column in columns])
    columns = [
        replace(each, heading=replace(each.heading, name=new))
        for each, new in zip(columns, names, strict=True)
    ]
    times, about_times = _find_times(columns, rows)
    series = tuple(
        Series(
            channel=Channel(name=column.heading.name, unit=column.heading.unit),
            values=column.values,
            t=_times_for(column, times) if column.t is None else column.t,
        )
        for column in columns
    )
    name_findings = (*name_findings, *_units_in_names(columns), *about_times, *_about_own_times(columns))
    return Recording(name=name, series=series, source=source, findings=(*findings, *name_findings))


def _about_own_times(columns: Sequence[Column]) -> Iterable[Finding]:
    """Findings on the times that columns have of their own, one for several columns with the same fault."""
    own = {column.t.tobytes(): column.t for column in columns if column.t is not None}
    return dict.fromkeys(finding for t in own.values() for finding in time_findings(t))


def _units_in_names(columns: Sequence[Column]) -> list[Finding]:
    units = [f"`{each.heading.name}` in {each.heading.unit}" for each in columns if each.heading.from_name]
    if not units:
        return []
    return [info("unit-in-name", f"The endings of names give units: {', '.join(units[:12])}.")]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Times:
    """A recognised time column: the folder that it stands in (`a.b.`) and its values [s]."""

    folder: str
    t: Array


def _folder(name: str) -> str:
    return name[: name.rfind(".") + 1]


def _is_named_time(heading: Heading) -> bool:
    last = _last_part(heading)
    return _is_time_word(last) or _is_time_word(bare_name(last))


def _is_surely_time(heading: Heading) -> bool:
    """Whether the whole name is that of a time; `loop_time_s` may be the duration of each turn of a loop."""
    last = _last_part(heading)
    return {last.lower(), bare_name(last).lower()} & TIME_NAMES != set()


def _last_part(heading: Heading) -> str:
    """A name without its folder, and without a remark such as that of `time(t)`."""
    remark = _remark_of_time(heading.name)
    return remark["name"].strip() if remark else heading.name[len(_folder(heading.name)) :]


def _is_unit_of_time(symbol: str) -> bool:
    return is_unit(symbol) and unit(symbol).quantity == "time"


def _remark_of_time(name: str) -> re.Match[str] | None:
    """The parts of a time's name that has a remark behind it; None of any other name."""
    remark = REMARK.fullmatch(name[len(_folder(name)) :])
    return remark if remark and remark["name"].strip().lower() in TIME_NAMES else None


def time_unit(heading: Heading) -> str | None:
    """Return the unit of a column that is called a time; None where it has none, or isn't called a time."""
    if not _is_named_time(heading):
        return None
    if heading.unit is not None:
        return heading.unit if _is_unit_of_time(heading.unit) else None
    remark = _remark_of_time(heading.name)
    if remark and (remark["inside"] or remark["between"]).strip().lower() not in _REMARKS_ON_TIME:
        return None  # it may be a unit that isn't known here, and seconds would be a guess
    return "s" if _last_part(heading).lower() in SECONDS_BY_CONVENTION else None


def _find_times(columns: Sequence[Column], rows: Rows | None) -> tuple[list[_Times], list[Finding]]:
    """The columns that are times beyond doubt, and what is to be known of them."""
    candidates: dict[tuple[str, int], list[Column]] = {}
    recognised: list[_Times] = []
    findings: list[Finding] = []
    for column in columns:
        if column.t is not None or (not column.is_time and time_unit(column.heading) is None):
            continue
        if _mostly_increases(column.values):
            key = (_folder(column.heading.name), len(column.values))
            candidates.setdefault(key, []).append(column)
        elif _is_surely_time(column.heading):
            sentence = f"`{column.heading.name}` isn't used as the time, despite its name: {_why_no_time(column.values)}."
            findings.append(info("time-not-recognised", sentence))
    for (folder, _), named in candidates.items():
        alike = [each for each in named if each.is_time or _is_surely_time(each.heading)] or named
        names = [column.heading.name for column in alike]
        if len(alike) > 1:
            sentence = f"Each of {quote(names)} may be the time; say which with `time=COL:UNIT`."
            findings.append(info("time-ambiguous", sentence))
            continue
        symbol = time_unit(alike[0].heading) or "s"
        factor = unit(symbol).factor
        with np.errstate(over="ignore"):
            t = alike[0].values if factor == 1.0 else alike[0].values * factor
        recognised.append(_Times(folder=folder, t=t))
        findings.append(_time_finding(alike[0], symbol, t))
        findings.extend(time_findings(t, rows))
    return recognised, findings


def _time_finding(column: Column, symbol: str, t: Array) -> Finding:
    step, name = time_base(t).median_step, column.heading.name
    sentence = f"`{name}` is used as the time, in {symbol}: its median step is {step:.4g} s."
    dates = epoch_unit(column.values)
    if column.heading.unit is None and dates not in (None, symbol):
        sentence += (
            f" The unit is by convention; in {dates} the times would be dates: say `time={name}:{dates}`."
        )
    elif column.heading.unit is None:
        sentence += f" The unit is by convention; if it is wrong, say `time={name}:ms` or the right unit."
    return info("time-recognised" if column.heading.unit is None else "time-stated", sentence)


def _why_no_time(values: Array) -> str:
    """The reason why a column can't be times, and the remedy where its rows are only out of order."""
    values = values[np.isfinite(values)]
    if len(values) < 2:
        return "it has only one row, and a motion needs several" if len(values) else "it has no number"
    if _mostly_increases(values[::-1]):
        return "it runs backwards; sort the rows by it, the earliest first"
    steps = np.diff(values)
    if steps.min() >= 0:
        return f"it stays the same from one row to the next {count_text(int(np.sum(steps == 0)), 'time')}"
    if is_out_of_order(values):
        back = f"it goes back {count_text(int(np.sum(steps < 0)), 'time')}; sort the rows by it"
        if sorts_evenly(values):
            return f"{back}, the earliest first"
        return f"{back} if they are only out of order; a computed duration, which goes back all along, is no time"
    return "it doesn't increase"


def _mostly_increases(values: Array) -> bool:
    """Whether a column can be times at all, slips and several runs included: most steps go forward."""
    with np.errstate(over="ignore"):
        steps = np.diff(values[np.isfinite(values)])
    return len(steps) > 0 and float(np.mean(steps > 0)) > 0.6


def _times_for(column: Column, times: Sequence[_Times]) -> Array | None:
    """The times of the time column of the same length that stands nearest to a column, going up from its folder."""
    folder = _folder(column.heading.name)
    near = [each for each in times if folder.startswith(each.folder) and len(each.t) == len(column.values)]
    return max(near, key=lambda each: len(each.folder)).t if near else None
