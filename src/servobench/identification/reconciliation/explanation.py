"""The noun `Explanation`: why figures differ, as values, as sentences, and as plain data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from servobench.core.finding import Finding, Verdict
from servobench.core.json_numbers import finite
from servobench.identification.reconciliation.base import Decision, Name, Origin
from servobench.identification.reconciliation.judgement import JudgedCause, Share, Size
from servobench.identification.reconciliation.probabilities import Hypothesis
from servobench.identification.reconciliation.readings import Reading

SCHEMA = "servobench.why/1"


@dataclass(frozen=True, kw_only=True)
class Difference:
    """A figure of the data and the other one, a claim's or a data sheet's, each with half of its 95 % interval."""

    name: Name
    """The figure."""
    unit: str
    """The unit of all four."""
    data: float
    data_half: float
    """Half of the 95 % interval of the data."""
    other: float
    other_half: float
    """Half of the 95 % interval of the other one."""

    @property
    def ratio(self) -> float:
        """The other figure over that of the data."""
        return self.other / self.data


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanation:
    """An explanation of differing figures: the differences, methods' readings of the same data, causes, the deciding experiment.

    `causes` are all that were weighed, the most probable first; a cause's probability is that of taking part, alone or with
    another one, and 0 where it isn't possible. `hypotheses` are the sets of possible causes, whose probabilities add up to
    one. `alike` are the causes that these data can't separate from the first one. `agrees` says that chance is enough. Where
    the data can't support a model (`verdict` refused), there are no differences, and the sentences say why.
    """

    verdict: Verdict
    findings: tuple[Finding, ...]
    """Remarks on the data."""
    origin: Origin
    """Whose figures are compared with the data: a claim's, or a data sheet's."""
    differences: tuple[Difference, ...] = ()
    agrees: bool = False
    readings: tuple[Reading, ...] = ()
    """The values that methods read off the same data."""
    nearest: Reading | None = None
    """The reading that comes nearest to the claim."""
    causes: tuple[JudgedCause, ...] = ()
    hypotheses: tuple[Hypothesis, ...] = ()
    alike: tuple[str, ...] = ()
    decision: Decision | None = None
    """The experiment that decides about the first cause; None where none is possible."""
    sentences: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> JudgedCause:
        """Return what there is to say about the cause of that name."""
        return next(each for each in self.causes if each.name == name)

    def __str__(self) -> str:
        """The answer as sentences, one a line."""
        return "\n".join(self.sentences)

    __repr__ = __str__

    def to_dict(self) -> dict[str, Any]:
        """Return the explanation as plain data of the schema `servobench.why/1`; numbers are finite or None."""
        data = {
            "schema": SCHEMA,
            "verdict": str(self.verdict),
            "findings": [
                {
                    "code": each.code,
                    "severity": str(each.severity),
                    "sentence": each.sentence,
                    "parameters": list(each.parameters),
                    "rows": list(each.rows) if each.rows else None,
                }
                for each in self.findings
            ],
            "origin": self.origin,
            "agrees": self.agrees,
            "differences": [_difference(each) for each in self.differences],
            "readings": [_reading(each) for each in self.readings],
            "nearest_reading": self.nearest.method if self.nearest else None,
            "causes": [_cause(each) for each in self.causes],
            "hypotheses": [
                {"causes": list(each.causes), "probability": each.probability} for each in self.hypotheses
            ],
            "alike": list(self.alike),
            "decision": None if self.decision is None else _decision(self.decision),
            "sentences": list(self.sentences),
        }
        plain: dict[str, Any] = finite(data)
        return plain


def _difference(each: Difference) -> dict[str, Any]:
    return {
        "name": each.name,
        "unit": each.unit,
        "data": {"value": each.data, "half_width": each.data_half},
        "other": {"value": each.other, "half_width": each.other_half},
        "ratio": each.ratio,
    }


def _reading(each: Reading) -> dict[str, Any]:
    return {
        "method": each.method,
        "chain": each.chain,
        "gain": each.gain,
        "time_constant": each.time_constant,
        "simulated": each.simulated,
        "why_not": each.why_not,
    }


def _cause(each: JudgedCause) -> dict[str, Any]:
    return {
        "name": each.name,
        "label": each.label,
        "law": each.law,
        "probability": each.probability,
        "possible": each.possible,
        "against": each.against,
        "needed": _size(each.needed),
        "likely": _size(each.likely),
        "explains": [_share(share) for share in each.explains],
        "decision": _decision(each.decision),
    }


def _size(size: Size | None) -> dict[str, Any] | None:
    if size is None:
        return None
    return {"value": size.value, "text": size.text, "low": size.low, "high": size.high}


def _share(share: Share) -> dict[str, Any]:
    return {"name": share.name, "share": share.value, "interval": list(share.interval)}


def _decision(decision: Decision) -> dict[str, Any]:
    toml = None if decision.experiment is None else decision.experiment.to_toml()
    return {"sentence": decision.sentence, "experiment": toml}
