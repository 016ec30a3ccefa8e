"""The real recordings that identification is judged by: where each one is, what its columns are, and which motor it shows.

They are other people's files, in the folder that `SERVOBENCH_REAL_DATA` names or in `../shared/data` beside the checkout; the
README of each folder there says where it comes from. Recordings of one motor are replicates: what one says, the others must
bear out.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from servobench.core.channels import Channel
from servobench.recordings.formats.base import load
from servobench.recordings.formats.mapping import assign
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.measure import measure
from servobench.recordings.recording import Recording, Series

ROOT = Path(__file__).resolve().parent.parent.parent
FOLDER = Path(os.environ.get("SERVOBENCH_REAL_DATA") or ROOT.parent / "shared" / "data")


@dataclass(frozen=True, kw_only=True)
class RealRecording:
    """One recording, and the motor it shows.

    `file` is its path below the folder of real recordings, `recording` its name there where the file holds several.
    `roles` are arguments of `assign`. `duty` [%] is a constant input that stands in the file's name only.
    """

    motor: str
    file: str
    roles: Mapping[str, str] = field(default_factory=dict)
    recording: str = ""
    duty: float | None = None

    @property
    def name(self) -> str:
        """The recording's name in tables."""
        return f"{self.file}#{self.recording}" if self.recording else self.file

    def dataset(self) -> Dataset:
        """Return the recording as identification takes it; raises what `load`, `assign` and `measure` raise."""
        found = [each for each in load(FOLDER / self.file) if self.recording in ("", each.name)]
        return measure(assign(_with_duty(found[0], self.duty), **self.roles))


def _with_duty(recording: Recording, duty: float | None) -> Recording:
    if duty is None:
        return recording
    values = np.full(len(recording.series[0].values), duty)
    series = Series(channel=Channel(name="duty", unit="%"), values=values, t=None)
    return replace(recording, series=(*recording.series, series))


def usable() -> tuple[RealRecording, ...]:
    """Return the recordings from which a first-order motor's gain or time constant can be known."""
    return (*_laboratory(), *_robots(), *_lego(), *_hobby())


def _laboratory() -> list[RealRecording]:
    fra233 = (
        "19-54-24_Step",
        "20-01-36_Sine_pi_2",
        "20-06-51_Sine_pi",
        "20-09-36_Sine_2pi",
        "20-12-42_Stair",
        "20-21-20_Chirp",
        "20-22-09_Chirp",
    )
    roles = {"input": "sig_volt:V", "output": "sig_speed:rad/s"}
    entries = [
        RealRecording(motor="fra233", file=f"fra233/2026-02-06_{name}.mat", roles=roles) for name in fra233
    ]
    for name, output in (("prbs_open", "y:deg/s"), ("step_open", "y:deg/s"), ("profile_closed", "y:deg")):
        file = f"undcmotor/und_DCmotor_{name}_exp.csv"
        entries.append(RealRecording(motor="undcmotor", file=file, roles={"output": output}))
    for name in ("DATA_EMPS", "DATA_EMPS_PULSES"):
        roles = {"input": "vir:V", "output": "qm:m"}
        entries.append(RealRecording(motor="emps", file=f"emps/{name}.mat", roles=roles))
    for name in ("data2_1v", "data3_1v"):
        roles = {"time": "time:s", "input": "voltage:V", "output": "theta1:rad"}
        entries.append(RealRecording(motor="qube3", file=f"qube3_steps/{name}.csv", roles=roles))
    return entries


def _robots() -> list[RealRecording]:
    tests = ("slow-forward", "slow-backward", "fast-forward", "fast-backward")
    drives = (
        ("romi", "romi_sysid/romi_sysid_data20221106-174834.json", "velocity"),
        ("romi-small", "romi_sysid/romi_sysid_data20221106-172256.json", "velocity"),
        ("swerve", "swerve_sysid/12_12_Swerve.json", "position"),
    )
    return [
        RealRecording(
            motor=f"{drive}-{side}",
            file=file,
            recording=test,
            roles={"input": f"{side}_voltage", "output": f"{side}_{output}"},
        )
        for drive, file, output in drives
        for side in ("left", "right")
        for test in tests
    ]


def _lego() -> list[RealRecording]:
    roles = {"time": "2:s", "input": "1:%", "output": "4:deg"}
    small = [
        RealRecording(motor="ev3", file=f"ev3_duty/data{duty}.csv", roles=roles)
        for duty in (100, 60, -80, -40)
    ]
    roles = {"time": "1:s", "input": "duty:%", "output": "2:deg"}
    large = [
        RealRecording(
            motor="ev3-large",
            file=f"ev3_large/dataLargeMotor_black_{duty}pwr_1000sec.txt",
            roles=roles,
            duty=float(duty),
        )
        for duty in range(10, 101, 5)
    ]
    return small + large


def _hobby() -> list[RealRecording]:
    stairs = {"time": "time:s", "input": "voltage:V", "output": "rpm:rpm"}
    entries = [RealRecording(motor="l298", file="l298_stairs/run_minimal.csv", roles=stairs)]
    averaged = {
        "time": "Tempo:s",
        "input": "Degrau:1",
        "output": "Velocidade:rpm",
        "chain": "average 0.128 s",
    }
    for name in ("Feb-09-2022--14-42-41", "Jan-15-2022--19-17-53"):
        entries.append(RealRecording(motor="waam", file=f"waam_average/{name}.csv", roles=averaged))
    columns = {"input": "4:%", "output": "2:deg", "sample_time": "0.002"}
    for name in ("gk_pid", "gk_pid_step", "gk_repetitive"):
        entries.append(RealRecording(motor="gkeiel", file=f"gkeiel_pot_servo/{name}.csv", roles=columns))
    return entries
