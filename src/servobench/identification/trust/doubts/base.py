"""The kind `doubts`: checks of data and estimates, before and after the fit, each a finding with what to do about it.

A doubt is one file in this folder, which gives a `Doubt` to `DOUBTS.member(name)`. Each code of its findings needs a row in
`core/finding_codes.py`, which says what it means and what to do, for the reference page (`make generate`), and an example in
`tests/contracts/finding_examples`.

Before the fit, a doubt prevents a useless fit (a refusal) or reports what the fit can't know; after the fit, it judges the
result. Doubts are cheap: none of them fits a model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from servobench.core.finding import Finding
from servobench.core.registry import Registry
from servobench.identification.estimators.base import Fit
from servobench.recordings.measurement.dataset import Dataset
from servobench.rig.motor.parameters import MotorParameters

AboutData: TypeAlias = Callable[[Sequence[Dataset]], Sequence[Finding]]
AboutFit: TypeAlias = Callable[[Fit], Sequence[Finding]]
AboutNominal: TypeAlias = Callable[[Fit, MotorParameters], Sequence[Finding]]
BesideNominal: TypeAlias = Callable[[Sequence[Dataset], MotorParameters], Sequence[Finding]]


def _nothing(*_: object) -> Sequence[Finding]:
    return ()


@dataclass(frozen=True, kw_only=True)
class Doubt:
    """One doubt, or a small family: the codes of its findings, and when it can say something.

    `about_data` looks at the records before any fit, `about_fit` at a fit, `about_nominal` at a fit beside the parameters that
    the motor should have, `beside_nominal` at the records beside them, before any fit. Each returns no finding where there is
    nothing to say.
    """

    codes: tuple[str, ...]
    about_data: AboutData = _nothing
    about_fit: AboutFit = _nothing
    about_nominal: AboutNominal = _nothing
    beside_nominal: BesideNominal = _nothing


DOUBTS: Registry[Doubt] = Registry("doubt", "servobench.identification.trust.doubts", "servobench.doubts")


def about_data(records: Sequence[Dataset], nominal: MotorParameters | None = None) -> list[Finding]:
    """Return what can be said of the data before any fit, beside `nominal` parameters where there are any."""
    findings = [finding for doubt in DOUBTS for finding in doubt.about_data(records)]
    if nominal is not None:
        findings += [finding for doubt in DOUBTS for finding in doubt.beside_nominal(records, nominal)]
    return findings


def about_fit(fit: Fit, nominal: MotorParameters | None = None) -> list[Finding]:
    """Return what the estimates themselves give to think, and what they do beside `nominal` parameters where there are any."""
    findings = [finding for doubt in DOUBTS for finding in doubt.about_fit(fit)]
    if nominal is not None:
        findings += [finding for doubt in DOUBTS for finding in doubt.about_nominal(fit, nominal)]
    return findings
