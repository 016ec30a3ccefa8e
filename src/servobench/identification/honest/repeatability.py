"""The verb honest: a comparison of several runs of one motor."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Unpack

import numpy as np

from servobench.core.arguments import check_mapping, check_type, to_number
from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable, UsageError
from servobench.core.finding import Finding, info, warning
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import round_value
from servobench.identification.honest.causes import Cause, Trend, causes, follows_the_angle, trends, warming
from servobench.identification.honest.scatter import Scatter, scatter
from servobench.identification.identify import identify
from servobench.identification.result import Result
from servobench.identification.uncertainty.identifiability import State
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.reading import ReadingOptions, datasets_in

SCHEMA = "servobench.honest/1"
_CHANCE = 0.05  # that runs of one motor are said to differ in any parameter
_SHAPE = 0.25  # of the largest input: a ramp and a step differ by more in mean size, two ways in their ends
_FEW = 5  # runs below which little can be said


@dataclass(frozen=True, kw_only=True, repr=False)
class Honesty:
    """The evidence of n runs on the intervals: the scatter of each of the `parameters`, what follows what (`trends`), causes, and
    findings.

    `structure` is that of all fits. `left_out` names runs that support no model.
    """

    runs: tuple[str, ...]
    left_out: tuple[str, ...]
    structure: str
    parameters: tuple[Scatter, ...]
    causes: tuple[Cause, ...]
    trends: tuple[Trend, ...]
    findings: tuple[Finding, ...]

    def __str__(self) -> str:
        """A line for each parameter, with its interval over all runs, and what was found."""
        lines = [f"{len(self.runs)} runs, {self.structure}"]
        for each in self.parameters:
            over = round_value(each.mean, 0.5 * (each.interval[1] - each.interval[0]), each.unit)
            lines.append(
                f"{each.label:16} {over}, {each.covered} of {len(self.runs)} intervals hold the mean of the others"
            )
        return "\n".join([*lines, *(f"- {finding.sentence}" for finding in self.findings)])

    __repr__ = __str__

    @property
    def covers(self) -> bool:
        """Whether the runs differ by no more than their intervals say."""
        return not any(each.differs for each in self.parameters)

    def __getitem__(self, name: str) -> Scatter:
        """Return how a parameter scatters."""
        return next(each for each in self.parameters if each.name == name)

    def to_dict(self) -> dict[str, Any]:
        """Return the same as plain data of the schema `servobench.honest/1`."""
        return {
            "schema": SCHEMA,
            "covers": self.covers,
            "runs": list(self.runs),
            "left_out": list(self.left_out),
            "structure": self.structure,
            "parameters": {each.name: each.to_dict() for each in self.parameters},
            "causes": [
                {"name": c.name, "share": c.share, "changes": list(c.changes), "sentence": c.sentence}
                for c in self.causes
            ],
            "trends": [
                {"parameter": t.parameter, "follows": t.follows, "sense": t.sense, "p": t.p}
                for t in self.trends
            ],
            "findings": [
                {
                    "code": f.code,
                    "severity": str(f.severity),
                    "sentence": f.sentence,
                    "parameters": list(f.parameters),
                }
                for f in self.findings
            ],
        }


def honest(
    data: object = None,
    structure: str = "auto",
    estimator: str = "auto",
    beside: Mapping[str, Sequence[float]] | None = None,
    *,
    starts_at_rest: bool = False,
    **options: Unpack[ReadingOptions],
) -> Honesty:
    """Return whether the 95 % intervals of repeated runs of one motor agree with each other; if not, widened
    intervals and the cause.

    `data` are the runs, read as by `identify`: a list of paths, DataFrames, recordings or datasets, or lists
    of arrays. Each one is a run, in chronological order. All get the same structure; "auto" is the one that
    most of them need. `beside` are values recorded with the runs, such as a temperature, to test whether the
    motor depends on them; the number of the run, the size of the input and the angle at the start are always
    tested. The tests of one procedure in one file, such as a ramp and a step each way, aren't repeated runs
    of one experiment. Raises `NotIdentifiable` if fewer than two runs support a model, `UsageError` for a
    single run, for values in `beside` that don't match the runs, and for the tests of one procedure.

    >>> import servobench as sb
    >>> with sb.connect("twin") as motor:
    ...     runs = [sb.run(sb.Experiment(duration="2 s"), motor) for _ in range(3)]
    >>> honest(runs).covers
    True
    """
    check_type("structure", structure, str, "a name, or 'auto'")
    check_type("estimator", estimator, str, "a name, or 'auto'")
    if beside is not None:
        check_mapping("beside", beside, '{"temperature": [21.5, 24.0, 30.5]}')
    return _compare_runs(
        datasets_in(data, starts_at_rest=starts_at_rest, **options), structure, estimator, beside or {}
    )


def _compare_runs(
    data: Sequence[Dataset], structure: str, estimator: str, beside: Mapping[str, Sequence[float]]
) -> Honesty:
    for what, values in beside.items():
        check_type(f"beside[{what!r}]", values, (Sequence, np.ndarray), "a list of numbers, one for each run")
        if len(values) != len(data):
            raise UsageError(f"{what}: {len(values)} values for {len(data)} runs; expected one for each run")
    if len(data) < 2:
        raise UsageError(
            f"{len(data)} run, and a comparison needs at least two: give more recordings of the motor"
        )
    _check_repeated(data)
    results = _results(data, structure, estimator)
    used = [n for n, result in enumerate(results) if result.fit is not None]
    known = [result.fit for result in results if result.fit is not None]
    if len(known) < 2:
        raise NotIdentifiable(
            f"{len(known)} of {len(data)} runs support a model, and a comparison needs at least two: record more "
            "runs, or name a structure (`structure=...`)"
        )
    compared = [results[n] for n in used]
    scatters = _scatters(compared)
    different = [each.name for each in scatters if each.differs and each.name in known[0].model.names]
    apart = {
        "the number of the run": [float(n) for n in used],
        "the size of the input": [float(np.abs(data[n].u).max()) for n in used],
        **{
            what: [to_number(f"beside[{what!r}]", values[n]) for n in used] for what, values in beside.items()
        },
    }
    why = causes(known, different) if different else ()
    follows = trends(different, known, apart) + follows_the_angle(different, known)
    return Honesty(
        runs=tuple(data[n].name for n in used),
        left_out=tuple(record.name for n, record in enumerate(data) if n not in used),
        structure=known[0].structure,
        parameters=scatters,
        causes=why,
        trends=follows,
        findings=(
            *_without_model([record.name for n, record in enumerate(data) if n not in used]),
            *_without_value(compared),
            *_findings(scatters, why, follows, [data[n] for n in used]),
        ),
    )


def _check_repeated(data: Sequence[Dataset]) -> None:
    """Raise `UsageError` where recordings of one file had inputs of different shapes: then they are different tests."""
    for n, one in enumerate(data):
        for other in data[:n]:
            same_file = bool(one.source.sha256) and one.source.sha256 == other.source.sha256
            if same_file and not _alike(one, other):
                raise UsageError(
                    f"{other.name} and {one.name} aren't runs of one experiment: their inputs differ in shape. "
                    "Repeat the whole procedure and compare the same test of each, or fit the tests together with "
                    "identify"
                )


def _alike(one: Dataset, other: Dataset) -> bool:
    """Whether two inputs have the same shape, whatever their size: their ends and mean size over the largest value."""
    return bool(np.abs(_shape(one) - _shape(other)).max() <= _SHAPE)


def _shape(data: Dataset) -> Array:
    largest = float(np.abs(data.u).max()) or 1.0
    u = data.u / largest
    return np.array([u.min(), u.max(), np.abs(u).mean()])


def _results(data: Sequence[Dataset], structure: str, estimator: str) -> list[Result]:
    """Each run identified by itself, all with one structure."""
    results = [identify(record, structure, estimator) for record in data]
    names = Counter(result.fit.structure for result in results if result.fit is not None)
    if len(names) < 2:
        return results
    common = names.most_common(1)[0][0]
    return [
        result
        if result.fit is not None and result.fit.structure == common
        else identify(record, common, estimator)
        for record, result in zip(data, results, strict=True)
    ]


def _scatters(results: Sequence[Result]) -> tuple[Scatter, ...]:
    """The scatter of each parameter, and of each combination, that every run knows.

    The chance of a false alarm is shared among them. Raises `NotIdentifiable` where there is nothing that all runs know.
    """
    unknown = _unknown(results)
    estimates_by_name = {
        name: [result[name] for result in results] for name in results[0].answers if name not in unknown
    }
    every = [{each.name: each for each in result.combinations} for result in results]
    # A speed belongs to its level: those of different levels aren't the same thing.
    common = {
        name: first.meaning
        for name, first in every[0].items()
        if all(name in each and each[name].meaning == first.meaning for each in every)
    }
    estimates_by_name |= {name: [each[name].estimate for each in every] for name in common}
    known = {
        name: estimates
        for name, estimates in estimates_by_name.items()
        if all(0 < each.sd < np.inf for each in estimates)
    }
    if not known:
        raise NotIdentifiable(
            "no parameter is determined by all of the runs, so there is nothing to compare: `servobench identify` says "
            "what each lacks"
        )
    return tuple(
        replace(
            scatter(
                name,
                estimates[0].unit,
                [each.value for each in estimates],
                [each.sd for each in estimates],
                _CHANCE / len(known),
            ),
            meaning=common.get(name, ""),
        )
        for name, estimates in known.items()
    )


def _unknown(results: Sequence[Result]) -> list[str]:
    """The parameters that one of the runs doesn't know by itself: what stands for them there isn't theirs."""
    return [
        name
        for name in results[0].answers
        if any(result.answers[name].state is not State.KNOWN for result in results)
    ]


def _without_value(results: Sequence[Result]) -> list[Finding]:
    names = _unknown(results)
    if not names:
        return []
    words = ", ".join(parameter_in_words(name, results[0][name].unit) for name in names)
    sentence = f"Not compared, as not every run determines these by itself: {words}."
    return [info("parameters-left-out", sentence, parameters=tuple(names))]


def _findings(
    scatters: Sequence[Scatter], why: Sequence[Cause], follows: Sequence[Trend], data: Sequence[Dataset]
) -> list[Finding]:
    findings = [_about(each, len(data)) for each in scatters if each.differs]
    repeated = _repeats(data)
    if not findings and not repeated:
        findings.append(
            info(
                "runs-agree",
                f"The {len(data)} runs differ no more than their intervals predict: there is no sign that the "
                "intervals are too narrow.",
            )
        )
    if len(data) < _FEW:
        findings.append(
            info(
                "few-runs",
                f"{len(data)} runs are few: scatter twice as large as stated could go unseen. Record ten.",
            )
        )
    if len(repeated) == len(data) - 1:
        findings.append(
            warning(
                "runs-identical",
                "All runs are identical to the last count, so they can't show how a motor varies from run to run. "
                "Either the same file was given again, or they come from a simulated motor without noise that "
                "starts at the same angle.",
            )
        )
    elif repeated:
        findings.append(
            warning(
                "runs-repeated",
                f"Some runs are identical to another one to the last count: {', '.join(repeated)}. They add nothing "
                "and make the runs look more alike than they are: give each recording once.",
            )
        )
    if any(each.differs for each in scatters):
        findings += _reasons(why, follows)
    return findings


def _repeats(data: Sequence[Dataset]) -> list[str]:
    """The names of the runs that an earlier one has been already, to the last count."""
    return [
        record.name
        for n, record in enumerate(data)
        if any(np.array_equal(record.y, other.y) and np.array_equal(record.u, other.u) for other in data[:n])
    ]


def _without_model(names: Sequence[str]) -> list[Finding]:
    if not names:
        return []
    return [
        warning(
            "runs-left-out",
            f"Left out, as they support no model: {', '.join(names)}. The other runs may be a lucky selection; "
            "use `servobench identify` to see why these were left out.",
        )
    ]


def _about(each: Scatter, runs: int) -> Finding:
    from servobench.core.rounding import plain, round_value

    half = 0.5 * (each.interval[1] - each.interval[0])
    narrow = 0.5 * (each.stated[1] - each.stated[0])
    return warning(
        "runs-differ",
        f"The {each.label} differs from run to run by {plain(each.ratio, 2)} times what each run's "
        f"interval predicts ({each.covered} of {runs} intervals cover the mean of the others). Over all runs it is "
        f"{round_value(each.mean, half, each.unit)}, an interval {plain(half / narrow, 2)} times as wide as stated.",
        parameters=(each.name,),
    )


def _reasons(why: Sequence[Cause], follows: Sequence[Trend]) -> list[Finding]:
    """The findings on the reason of the runs' differences."""
    findings = []
    for trend in follows:
        sense = {1: "rises", -1: "falls", 0: "changes"}[trend.sense]
        findings.append(
            info(
                "runs-follow",
                f"The {parameter_in_words(trend.parameter)} {sense} with {trend.follows} (by chance once in {1 / trend.p:.0f}).",
                parameters=(trend.parameter,),
            )
        )
    if not why:
        findings.append(
            info(
                "cause-unknown",
                "No single cause explains the differences between the runs: several things changed, or one that "
                "the model leaves out. Repeat the experiment without touching anything, then change one thing at a time.",
            )
        )
        return findings
    best = why[0]
    sentence = f"Explanation: {best.sentence} ({100 * best.share:.0f} % of the scatter)."
    if best.name == "resistance" and any(trend.follows == "the number of the run" for trend in follows):
        sentence += (
            f" A copper winding that is {warming(best):+.0f} K warmer in the last run than in the first "
            "would explain it."
        )
    if len(why) > 1:
        sentence += f" These fit equally well: {', '.join(cause.name for cause in why[1:])}."
    findings.append(info("cause-of-scatter", sentence))
    return findings
