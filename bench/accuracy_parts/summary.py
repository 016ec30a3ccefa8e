"""The figures of a row, from its runs."""

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

Run = dict[str, Any]
NAMES = ("gain", "time_constant")
_FAR = 3.0  # standard deviations


@dataclass(frozen=True, kw_only=True)
class Share:
    """A number of cases out of all of them."""

    count: int
    of: int

    @property
    def value(self) -> float:
        """The share; NaN of nothing."""
        return self.count / self.of if self.of else float("nan")

    @property
    def range(self) -> tuple[float, float]:
        """The 95 % range of the probability behind it (Wilson 1927)."""
        if not self.of:
            return (0.0, 1.0)
        z2, n = 1.96**2, self.of
        middle = (self.count + z2 / 2) / (n + z2)
        half = np.sqrt(z2 * (self.value * (1 - self.value) / n + z2 / (4 * n * n))) / (1 + z2 / n)
        return (max(float(middle - half), 0.0), min(float(middle + half), 1.0))


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """One parameter over all runs: RMSE and mean error over the bound, each with its Monte Carlo sd, and the coverage.

    `relative` is the root mean square of the relative errors; None where nothing was fitted.
    """

    relative: float | None
    rmse: float | None
    rmse_sd: float | None
    bias: float | None
    bias_sd: float | None
    coverage: Share


@dataclass(frozen=True, kw_only=True)
class Summary:
    """One row: how many runs, how accurate, and how good the verdicts are."""

    runs: int
    failed: int
    accuracy: dict[str, Accuracy]
    estimators: dict[str, float]
    structures: dict[str, float]
    verdicts: dict[str, float]
    trusted: Share
    trusted_and_wrong: Share
    fine_but_not_trusted: Share
    coverage_given_trusted: Share
    error_when_wrong: float | None
    error_when_trusted: float | None
    warnings: dict[str, float]
    seconds: float | None


def summarised(runs: list[Run]) -> Summary:
    """Return what the runs of a row say together."""
    fitted = [run for run in runs if "estimates" in run]
    trusted = [run for run in fitted if run["verdict"] == "trusted"]
    wrong = [run for run in trusted if _far(run) > _FAR]
    doubted = [run for run in runs if run["verdict"] != "trusted"]
    fine = [run for run in doubted if "estimates" in run and _far(run) <= _FAR]
    return Summary(
        runs=len(runs),
        failed=len(runs) - len(fitted),
        accuracy={name: _accuracy(fitted, name) for name in NAMES},
        estimators=_shares(run["estimator"] for run in fitted),
        structures=_shares(run["structure"] for run in fitted),
        verdicts=_shares(run["verdict"] for run in runs),
        trusted=Share(count=len(trusted), of=len(runs)),
        trusted_and_wrong=Share(count=len(wrong), of=len(runs)),
        fine_but_not_trusted=Share(count=len(fine), of=len(runs)),
        coverage_given_trusted=Share(
            count=sum(_covers(run, name) for run in trusted for name in NAMES), of=2 * len(trusted)
        ),
        error_when_wrong=_middle([_percent(run) for run in wrong]),
        error_when_trusted=_middle([_percent(run) for run in trusted]),
        warnings=_shares((code for run in runs for code in _against(run)), of=len(runs)),
        seconds=_middle([run["seconds"] for run in runs if "seconds" in run]),
    )  # fmt: skip


def _against(run: Run) -> list[str]:
    """The codes of what spoke against a result."""
    found = run.get("findings", {})
    return sorted({*found.get("warning", []), *found.get("refusal", [])})


def _accuracy(runs: list[Run], name: str) -> Accuracy:
    coverage = Share(count=sum(_covers(run, name) for run in runs), of=len(runs))
    errors = np.array([_error(run, name) for run in runs])
    relative = float(np.sqrt(np.mean(errors**2))) if len(errors) else None
    bounds = np.array([run["bound"][name] for run in runs if run["bound"]])
    if not relative or len(bounds) < len(errors):
        return Accuracy(
            relative=relative, rmse=None, rmse_sd=None, bias=None, bias_sd=None, coverage=coverage
        )
    scale = float(np.sqrt(np.mean(bounds**2)))
    # The sd of a mean of squares, carried over to its root.
    spread = float(np.std(errors**2)) / np.sqrt(len(errors)) / (2 * relative)
    return Accuracy(
        relative=relative,
        rmse=relative / scale,
        rmse_sd=float(spread / scale),
        bias=float(errors.mean() / scale),
        bias_sd=float(errors.std() / scale / np.sqrt(len(errors))),
        coverage=coverage,
    )


def _error(run: Run, name: str) -> float:
    """The relative error: how far an estimate is outside the range of true values."""
    low, high = run["truth"][name]
    value = run["estimates"][name][0]
    return float((value - min(max(value, low), high)) / (0.5 * (low + high)))


def _far(run: Run) -> float:
    """By how many of its standard deviations gain or time constant is off, the worse of the two."""
    worst = 0.0
    for name in NAMES:
        low, high = run["truth"][name]
        value, sd = run["estimates"][name][:2]
        off = abs(value - min(max(value, low), high))
        worst = max(worst, off / sd if sd > 0 else (np.inf if off else 0.0))
    return worst


def _covers(run: Run, name: str) -> bool:
    low, high = run["truth"][name]
    bottom, top = run["estimates"][name][2:4]
    return bool(bottom <= high and top >= low)


def _percent(run: Run) -> float:
    """The larger of the two relative errors [%]."""
    return 100 * max(abs(_error(run, name)) for name in NAMES)


def _middle(values: list[float]) -> float | None:
    return float(np.median(values)) if values else None


def _shares(items: Any, of: int | None = None) -> dict[str, float]:
    counted = Counter(items)
    total = of if of is not None else counted.total()
    return {name: count / total for name, count in counted.most_common()}
