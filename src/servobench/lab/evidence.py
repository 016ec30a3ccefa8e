"""The facts, by name, of the experiment, the device, its data sheet and a recording.

`sample_time`, `duration` [s]; `counts_per_rev`, `counter_bits` and `voltage_limit` [V] of the device; `sheet_resistance`,
`sheet_gain` and the like, what the data sheet that is the experiment's `nominal` says; `read_gain` [rad/(s·V)] and
`read_time_constant` [s], as read off the speed behind the chain by 63.2 %; `chain_lag` [s], what the chain delays a motor of the
identified time constant by; and the identified parameters, such as `gain` and `time_constant`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from servobench.core.channels import DeviceInfo
from servobench.core.errors import NotIdentifiable
from servobench.core.finding import Severity
from servobench.core.rounding import with_unit
from servobench.lab.expression import Fact
from servobench.lab.rules import identifiable
from servobench.recordings.measurement.base import Chain
from servobench.rig.experiment import Experiment

if TYPE_CHECKING:
    from servobench.identification.result import Result
    from servobench.recordings.recording import Recording

_READ, _SHEET = "read_", "sheet_"
_READINGS = ("gain", "time_constant")
_LAG = "chain_lag"
# Of a motor: where the interval is as large as themselves, they aren't known.
_NEVER_ZERO = ("gain", "time_constant")


@dataclass(frozen=True, eq=False)
class Evidence(Mapping[str, Fact]):
    """The facts of one experiment by name, computed on first use: an encoder's counts need no run of the motor.

    `info` describes the device that the experiment is for, `record` returns its recording.
    Raises `NotIdentifiable` where an identified fact is requested that the recording can't tell.
    """

    experiment: Experiment
    info: DeviceInfo
    record: Callable[[], Recording]

    def __getitem__(self, name: str) -> Fact:
        """Return a fact; raises `KeyError` where there is none of that name."""
        if name in self._stated:
            return self._stated[name]
        facts, result = (
            (self._read, self._reading) if name.startswith(_READ) else (self._found, self._identified)
        )
        if result is not None and result.fit is None and name in _identifiable():
            why = "; ".join(f.sentence for f in result.findings if f.severity is Severity.REFUSAL)
            raise NotIdentifiable(f"the recording doesn't determine {name}: {why}")
        fact = facts[name]
        if name in _NEVER_ZERO and fact.half >= fact.value:
            raise NotIdentifiable(
                f"the recording doesn't determine {name}: its 95 % interval is "
                f"±{with_unit(fact.half, identifiable()[name], 2)}, as large as itself"
            )
        return fact

    def __iter__(self) -> Iterator[str]:
        return iter({**self._stated, **self._read, **self._found})

    def __len__(self) -> int:
        return len(list(iter(self)))

    @cached_property
    def _stated(self) -> dict[str, Fact]:
        """The facts that need no run."""
        counts, voltage = self.info.channel("counts"), self.info.channel("voltage")
        values = {
            "sample_time": self.experiment.sample_time,
            "duration": self.experiment.duration,
            "counts_per_rev": counts.counts_per_rev if counts else None,
            "counter_bits": counts.counter_bits if counts else None,
            "voltage_limit": voltage.maximum if voltage else None,
        }
        stated = {name: Fact(value=float(value)) for name, value in values.items() if value is not None}
        return {**stated, **self._sheet()}

    def _sheet(self) -> dict[str, Fact]:
        """The data sheet's facts on the motor and its amplifier, and gain, time constant and delay that follow."""
        if not self.experiment.nominal:
            return {}
        from servobench.identification.models.nominal import nominal_values
        from servobench.rig.motor.parameters import data_sheet

        sheet = data_sheet(self.experiment.nominal)
        values = {
            **asdict(sheet.motor),
            "inertia": sheet.motor.inertia,
            "voltage_limit": sheet.voltage_limit,
            "dead_band": sheet.dead_band,
            "counts_per_rev": sheet.counts_per_rev,
            "counter_bits": sheet.counter_bits,
            **nominal_values(sheet.motor),
        }
        return {f"{_SHEET}{name}": Fact(value=float(value)) for name, value in values.items()}

    @cached_property
    def _read(self) -> dict[str, Fact]:
        """The readings of the speed behind the chain; nothing where there is no speed to read."""
        if self._reading is None or self._reading.fit is None:
            return {}
        fit = self._reading.fit
        return {f"{_READ}{name}": Fact(value=fit[name].value) for name in _READINGS}

    @cached_property
    def _found(self) -> dict[str, Fact]:
        """The identified parameters, and the lag of the chain."""
        from servobench.identification.estimators.unseen_torque import SOURCE as UNSEEN_TORQUE
        from servobench.identification.uncertainty.model_error import SOURCE as MODEL_ERROR
        from servobench.recordings.measurement.lag import lag_of

        if self._identified.fit is None:
            return {}
        # What other motors teach of a recording with one event would let an answer pass that is a third off, and a torque that
        # may act unseen one that is a twentieth off.
        fit = self._identified.fit.without(MODEL_ERROR).without(UNSEEN_TORQUE)
        facts = {name: Fact(value=e.value, half=e.half_width) for name, e in fit.estimates.items()}
        tau = facts.get("time_constant")
        if tau is not None:
            facts[_LAG] = Fact(value=lag_of(self._chain, tau.value) if self._chain else 0.0)
        return facts

    @property
    def _chain(self) -> Chain:
        return Chain.parse(self.experiment.chain)

    @cached_property
    def _recording(self) -> Recording:
        return self.record()

    @cached_property
    def _reading(self) -> Result | None:
        from servobench.identification.identify import identify
        from servobench.recordings.measurement.measure import measure

        if self._chain.takes == "speed" or self._chain.yields("position") != "speed":
            return None  # a time to 63.2 % is read off a speed
        return identify(measure(self._recording, self._chain), estimator="step_63")

    @cached_property
    def _identified(self) -> Result:
        from servobench.identification.identify import identify
        from servobench.recordings.measurement.measure import measure

        return identify(measure(self._recording), nominal=self.experiment.nominal or None)


def _identifiable() -> set[str]:
    """The names of all facts that a recording may tell; one that tells none of them hasn't made a name wrong."""
    return {*identifiable()} | {_LAG} | {f"{_READ}{name}" for name in _READINGS}
