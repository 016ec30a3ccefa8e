"""The guard's limits in a run: each with its value, and whether it was reached."""

from __future__ import annotations

from servobench.core.channels import DeviceInfo
from servobench.core.rounding import count_text, plain
from servobench.core.units import quantity
from servobench.recordings.recording import Recording
from servobench.report.history import experiment_table
from servobench.rig.experiment.limits import Limits

Row = tuple[str, str, str]

_NEVER, _NOT_WATCHED = "never", "not watched"


def guard_rows(recording: Recording) -> tuple[Row, ...]:
    """Return a row for each limit of a run of ours: what it is about, its numbers, and whether it was reached.

    Nothing for recordings from elsewhere, for those of versions that wrote no such limits, and where nothing was driven.
    """
    from pydantic import ValidationError

    table = experiment_table(recording)
    device, limits_table = recording.info, table.get("limits")
    if (
        device is None
        or not isinstance(limits_table, dict)
        or "watchdog" not in limits_table
        or not _is_driven(device)
    ):
        return ()
    try:
        limits = Limits.model_validate(limits_table)
        sample_time = quantity(table.get("experiment", {}).get("sample_time"), "s")
        watched = _monitors(limits, device, sample_time, recording)
    except (ValidationError, ValueError):  # limits written by hand, or for another device
        return ()
    return (*_clipping(limits, recording), *watched, _watchdog(limits, recording))


def _is_driven(device: DeviceInfo) -> bool:
    from servobench.rig.devices.base import DEVICES

    return device.name not in DEVICES.names() or bool(getattr(DEVICES[device.name], "drives", True))


def _clipping(limits: Limits, recording: Recording) -> tuple[Row, ...]:
    """Voltage and slew, which are kept by clipping; which of the two it was isn't recorded."""
    number = int(recording["saturated"].values.sum()) if "saturated" in recording else 0
    text = f"at {count_text(number, 'sample')}" if number else _NEVER
    voltage = ("Voltage", f"at most {plain(limits.voltage, 6)} V, clipped", text)
    if limits.slew is None:
        return (voltage,)
    return (voltage, ("Slew", f"at most {plain(limits.slew, 6)} V/s, clipped", text))


def _monitors(limits: Limits, device: DeviceInfo, sample_time: float, recording: Recording) -> list[Row]:
    """The monitors, prepared as for the run."""
    from servobench.rig.devices.guard.base import MONITORS, Rig
    from servobench.rig.devices.guard.nominal import nominal_motor

    nominal = nominal_motor(limits.plausibility, device)
    rig = Rig(limits=limits, info=device, sample_time=sample_time, nominal=nominal)
    rows = []
    for kind in MONITORS:
        monitor = kind.of(rig)
        watched = (
            ("none", _NOT_WATCHED)
            if monitor is None
            else (monitor.limit, _text_of_limit(kind.codes, recording))
        )
        rows.append((kind.heading, *watched))
    return rows


def _watchdog(limits: Limits, recording: Recording) -> Row:
    timeout = f"a new voltage within {plain(1000 * limits.watchdog.timeout, 6)} ms"
    return ("Watchdog", timeout, _text_of_limit(("watchdog",), recording))


def _text_of_limit(codes: tuple[str, ...], recording: Recording) -> str:
    sentences = [finding.sentence for finding in recording.findings if finding.code in codes]
    return sentences[0] if sentences else _NEVER
