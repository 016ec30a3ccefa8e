"""What data and estimates give to think, before and after the fit: each doubt a finding with what to do about it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.estimators.base import Fit
from servobench.finding import Finding, info, refusal, warning
from servobench.measurement.dataset import Dataset


def about_data(records: Sequence[Dataset]) -> list[Finding]:
    """Return what can be said of the data before any fit."""
    own = (
        finding for record in records for doubt in (_chain_unknown, _time_unit) for finding in doubt(record)
    )
    return [*_input_constant(records), *_repeated(records), *own]


def about_fit(fit: Fit) -> list[Finding]:
    """Return what the estimates themselves give to think."""
    doubts = (_uncertain, _time_scale, _delay, _sense, _poor, _one_way, _local, _levels)
    return [finding for doubt in doubts for finding in doubt(fit)]


def _input_constant(records: Sequence[Dataset]) -> list[Finding]:
    """Whether the input ever changes: from one record to the next is enough."""
    levels = np.concatenate([np.append(record.u, record.input_before) for record in records])
    if np.ptp(levels) > 0:
        return []
    return [
        refusal(
            "input-constant",
            f"The input stays at {levels[0]:g} {records[0].input_unit} throughout, so nothing tells gain and friction apart; "
            "record steps between at least two levels.",
            parameters=("gain", "coulomb_voltage"),
        )
    ]


def _repeated(records: Sequence[Dataset]) -> list[Finding]:
    """Whether the same recording is there twice: it would count twice, and the intervals come out too narrow."""
    seen: set[tuple[str, str]] = set()
    for record in records:
        key = (record.source.sha256, record.name)
        if record.source.sha256 and key in seen:
            sentence = f"{record.name} is given more than once: it tells nothing new, and makes the intervals too narrow."
            return [warning("data-repeated", sentence)]
        seen.add(key)
    return []


def _chain_unknown(data: Dataset) -> list[Finding]:
    """Whether a speed comes without word of how it was measured."""
    found = []
    if data.kind == "speed" and not data.chain:
        found.append(
            warning(
                "chain-unknown",
                f"{data.name}: nobody says how this speed was measured. Counts that were differenced lag by half a sample "
                f"({500 * data.sample_time:.3g} ms), and a filter or an average before the recording adds its own lag to the "
                "delay and the time constant; say what it is with --chain, or record the position.",
                parameters=("time_constant", "delay"),
            )
        )
    return found


def _time_unit(data: Dataset) -> list[Finding]:
    """Whether times that are seconds by convention only would make a motor of minutes."""
    by_convention = any(finding.code == "time-recognised" for finding in data.findings)
    if not by_convention or data.sample_time < 0.5:
        return []
    sentence = (
        f"{data.name}: taken in seconds, as its name is usually meant, the time column makes samples {data.sample_time:.3g} s "
        "apart, which is slow for a motor; if it is in milliseconds, say so with --time COL:ms."
    )
    return [warning("time-unit-doubtful", sentence, parameters=("gain", "time_constant", "delay"))]


def _uncertain(fit: Fit) -> list[Finding]:
    """Whether gain and time constant are known at all, and how well."""
    found = []
    told = any(finding.code == "scatter-unknown" for finding in fit.findings)
    for name in ("gain", "time_constant"):
        if name not in fit.model.names:
            continue
        estimate = fit[name]
        if told and not np.isfinite(estimate.sd):
            continue
        relative = estimate.sd / abs(estimate.value) if estimate.value else np.inf
        if not relative < 0.5:
            found.append(
                refusal(
                    "parameter-unknown",
                    f"The data don't tell the {name.replace('_', ' ')}: {estimate.value:.3g} {estimate.unit} with a standard "
                    f"deviation of {estimate.sd:.3g}; record steps between several levels, each longer than the motor takes.",
                    parameters=(name,),
                )
            )
        elif relative > 0.05:
            sentence = f"The {name.replace('_', ' ')} is known to ±{196 * relative:.0f} % only."
            found.append(warning("parameter-uncertain", sentence, parameters=(name,)))
    return found


def _time_scale(fit: Fit) -> list[Finding]:
    """Whether the time constant lies between the sample time and the length of the record."""
    if "time_constant" not in fit.model.names:
        return []
    tau = fit["time_constant"].value
    step = max(record.data.sample_time for record in fit.records)
    longest = max(record.data.duration for record in fit.records)
    if tau < 2 * step:
        sentence = (
            f"The time constant, {tau:.3g} s, is less than two sample times of {step:.3g} s: sample faster."
        )
        return [warning("sampling-too-slow", sentence, parameters=("time_constant",))]
    if tau > 0.5 * longest:
        sentence = (
            f"The time constant, {tau:.3g} s, is longer than half of the longest record: record for longer."
        )
        return [warning("record-too-short", sentence, parameters=("time_constant", "gain"))]
    return []


def _delay(fit: Fit) -> list[Finding]:
    """Whether the output comes before its cause, and the search hasn't said so already."""
    if "delay" not in fit.model.names:
        return []
    delay, step = fit["delay"], fit.records[0].data.sample_time
    told = any(finding.parameters == ("delay",) for finding in fit.findings)
    if told or delay.value >= -3 * delay.sd or delay.value >= -0.6 * step:
        return []
    sentence = f"The output comes {-delay.value:.3g} s before the input that causes it: the two columns are out of step."
    return [warning("delay-negative", sentence, parameters=("delay",))]


def _sense(fit: Fit) -> list[Finding]:
    if "gain" not in fit.model.names:
        return []
    if fit["gain"].value >= 0:
        return []
    return [
        info(
            "sign-negative",
            "A positive input turns the motor in the negative direction.",
            parameters=("gain",),
        )
    ]


def _poor(fit: Fit) -> list[Finding]:
    if fit.fit_percent >= 50:
        return []
    return [
        warning(
            "fit-poor",
            f"The simulation explains only {fit.fit_percent:.0f} % of the output: this isn't the right model, or these "
            "aren't the right columns.",
        )
    ]


def _one_way(fit: Fit) -> list[Finding]:
    """What the one voltage stands for where the motor turned one way only."""
    if fit.structure != "first_order_one_way":
        return []
    estimate = fit["coulomb_voltage"]
    unit = estimate.unit
    together = info(
        "friction-and-offset-together",
        "The motor turned one way only, so Coulomb friction and an offset can't be told apart: coulomb_voltage is their sum. "
        "Let it turn both ways to separate them.",
        parameters=("coulomb_voltage",),
    )
    if abs(estimate.value) <= 3 * estimate.sd:
        return [together]
    if estimate.value < 0:
        sentence = (
            f"The friction voltage comes out negative, {estimate.value:.3g} {unit}: friction never helps. The motor isn't linear "
            "over these levels (it may saturate), or the input has an offset; the gain belongs to these levels only."
        )
        return [together, warning("offset-negative", sentence, parameters=("coulomb_voltage", "gain"))]
    return [
        together,
        info(
            "offset-found",
            f"{estimate.value:.4g} {unit} of the input are lost before the motor turns; a model without this offset would get "
            "the gain wrong.",
            parameters=("coulomb_voltage", "gain"),
        ),
    ]


def _local(fit: Fit) -> list[Finding]:
    """Whether the input stayed near one level, so that the gain belongs to that level only."""
    inputs = np.concatenate([record.data.u for record in fit.records])
    low, high = (float(level) for level in np.percentile(inputs, (1, 99)))
    largest = max(abs(low), abs(high))
    if high - low >= 0.5 * largest:
        return []
    unit = fit.records[0].data.input_unit
    return [
        warning(
            "gain-local",
            f"The input stayed between {low:.3g} and {high:.3g} {unit}: the gain and the offset belong to this operating point, "
            "and nothing is known of the motor elsewhere.",
            parameters=("gain", "coulomb_voltage"),
        )
    ]


def _levels(fit: Fit) -> list[Finding]:
    """Whether two points are all that the line through the levels has."""
    levels = np.unique(np.round(np.concatenate([record.data.u for record in fit.records]), 9))
    if len(levels) != 2:
        return []
    unit = fit.records[0].data.input_unit
    return [
        info(
            "two-levels",
            f"The input has two levels only, {levels[0]:g} and {levels[1]:g} {unit}: nothing shows whether the motor is linear "
            "between them; a staircase or a multisine would.",
            parameters=("gain",),
        )
    ]
