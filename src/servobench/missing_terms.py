"""Is something missing from the model's structure? A score test for each term that motors are known to have and a model may lack.

Each term is an extra input e(t) that depends on what the motor does, or something that the sensor adds: what it would add to the
output is a column c beside the Jacobian J. If the structure is right, the innovations r (of unit variance) have no part of c
that J can't have as well:

    t² = (C⊥'r)' (C⊥'C⊥)⁻¹ C⊥'r,   C⊥ = C - J (J'J)⁻¹ J'C

is χ² with as many degrees of freedom as the term has columns (Rao 1948). No parameter is fitted again. The rounding of an ideal
encoder is not quite white, which is why the limit lies well above what chance gives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from servobench.channels import Array
from servobench.estimators.base import Fit, FittedRecord
from servobench.estimators.covariance import andrews_lag, long_run
from servobench.estimators.disturbance import whitened
from servobench.finding import Finding, warning

_LIMIT = 5.0  # standard deviations of a normal number that is as improbable
_SMALL = 1e-4  # of the largest input: the size of the extra input, small enough for the response to be linear in it
_RIPPLES = range(1, 17)  # times a revolution


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """What a motor did, at the same times: input and speed over their largest values, position, and how far the record is gone.

    `gone` runs from -1 to 1; the position is in its own unit.
    """

    input: Array
    speed: Array
    position: Array
    gone: Array


@dataclass(frozen=True, kw_only=True)
class Term:
    """A term that a model may lack: its finding's code, a sentence, and what it adds to the input or to the output.

    `curved` is a parameter whose second derivative the term is like; `limit` is in standard deviations.
    """

    code: str
    sentence: str
    to_input: Callable[[Motion], tuple[Array, ...]] | None = None
    to_output: Callable[[Motion], tuple[Array, ...]] | None = None
    curved: str | None = None
    limit: float = _LIMIT


def _ripple(cycles: int) -> Term:
    return Term(
        code="ripple",
        sentence=f"Something repeats {cycles} times a revolution (cogging, a commutator, an eccentric encoder), which the "
        "model doesn't know; where the motor lingers at one angle it moves gain and time constant.",
        to_input=lambda m: (np.sin(cycles * m.position), np.cos(cycles * m.position)),
    )


# A fast pole 1/(1 + s d) is a delay d to first order; to second order it adds d²/2 times the second derivative by the delay.
_FAST_POLE = Term(
    code="fast-pole",
    sentence="What looks like a delay is partly the lag of a second, faster pole (the winding's, or a shaft that gives), "
    "which a first-order model takes into its time constant.",
    curved="delay",
    limit=3.5,
)

TERMS = (
    Term(
        code="friction-depends-on-speed",
        sentence="Friction is not the same at all speeds: near standstill it differs from what the model takes everywhere "
        "(Stribeck), which moves gain and time constant.",
        to_input=lambda m: (-np.sign(m.speed) * np.exp(-np.abs(m.speed) / 0.1),),
    ),
    Term(
        code="drag-not-linear",
        sentence="The speed doesn't follow the input in proportion: drag grows faster or slower than the speed, so that the gain "
        "belongs to this range of speeds only.",
        to_input=lambda m: (-m.speed * np.abs(m.speed),),
    ),
    Term(
        code="directions-differ",
        sentence="The motor answers differently in its two directions; one gain for both is a mean of the two.",
        to_input=lambda m: (m.input * np.sign(m.speed),),
    ),
    Term(
        code="motor-changes",
        sentence="The motor wasn't the same at the end of the record as at its beginning: it warmed up, or its friction or its "
        "supply changed. What was found is a mean over the record.",
        to_input=lambda m: (m.input * m.gone, m.speed * m.gone),
    ),
    Term(
        code="friction-changes",
        sentence="Friction, or the input's offset, wasn't the same at the end of the record as at its beginning.",
        to_input=lambda m: (np.sign(m.speed) * m.gone, m.gone),
    ),
    Term(
        code="backlash",
        sentence="The output lags behind whenever the motion turns round, as behind a gear with backlash: near a reversal the "
        "model is wrong, and gain and time constant suffer from it.",
        to_output=lambda m: (np.sign(m.speed),),
    ),
    _FAST_POLE,
    *(_ripple(cycles) for cycles in _RIPPLES),
)


def missing_terms(fit: Fit) -> list[Finding]:
    """Return a finding for each term that the data ask for and the structure lacks; of several ripples, the strongest."""
    largest = max(float(np.abs(record.data.u).max(initial=0.0)) for record in fit.records)
    if largest == 0 or not np.isfinite(fit.residual_sd) or fit.residual_sd == 0:
        return []
    test = _Test(fit, largest)
    strongest: dict[str, tuple[float, Term]] = {}
    for term, size in test.sizes():
        if size > max(term.limit, strongest.get(term.code, (0.0, term))[0]):
            strongest[term.code] = (size, term)
    return [
        warning(
            code,
            f"{term.sentence} ({size:.0f} standard deviations.)",
            parameters=("gain", "time_constant"),
        )
        for code, (size, term) in strongest.items()
    ]


def fast_pole_doubt(fit: Fit) -> Array:
    """Return the covariance (P, P) that not knowing what the delay is made of adds to that of the parameters.

    A part φ of the delay d, between none and all, may be the lag of a fast pole. The output then has φ c more, c = d²/2 times
    its second derivative by d, and the parameters are off by φ b, b = (J'J)⁻¹ J'c. What the innovations say of φ is a normal
    distribution cut at 0 and 1; the doubt is b b' E[φ²]. It vanishes where the data show a pure delay.
    """
    shared = len(fit.model.theta)
    none = np.zeros((shared, shared))
    delay = fit.model["delay"] if "delay" in fit.model.names else 0.0
    if delay <= 0 or not np.isfinite(fit.residual_sd) or fit.residual_sd == 0:
        return none
    test = _Test(fit, 1.0)
    column = 0.5 * delay**2 * np.concatenate([run.columns(_FAST_POLE) for run in test.runs])[:, 0]
    rest = column - test.basis @ (test.basis.T @ column)
    power = float(rest @ rest)
    if not power > 1e-20 * float(column @ column):
        return none
    score = (rest * test.innovations)[:, None]
    spread = max(power, float(long_run(score, andrews_lag(score))[0, 0]))
    share = _squared_share(float(score.sum()) / power, float(np.sqrt(spread)) / power)
    off = np.linalg.lstsq(test.jacobian / test.scale, column, rcond=1e-12)[0] / test.scale
    return np.asarray(share * np.outer(off[:shared], off[:shared]), dtype=np.float64)


def _squared_share(mean: float, sd: float) -> float:
    """E[φ²] of a normal φ that is known to lie between 0 and 1."""
    nodes = np.linspace(0.0, 1.0, 201)
    weights = np.exp(-0.5 * ((nodes - mean) / sd) ** 2 + 0.5 * ((np.clip(mean, 0.0, 1.0) - mean) / sd) ** 2)
    return float(np.sum(weights * nodes**2) / np.sum(weights))


class _Test:
    """The score test of one fit: the parts that all terms share."""

    def __init__(self, fit: Fit, largest: float) -> None:
        self.fit = fit
        self.runs = [_Run(fit, record, largest) for record in fit.records]
        jacobian = _joint([_jacobian(fit, record) for record in fit.records], len(fit.model.theta))
        scale = np.linalg.norm(jacobian, axis=0)
        self.jacobian, self.scale = jacobian, np.where(scale > 0, scale, 1.0)
        self.basis = np.linalg.qr(jacobian[:, scale > 0] / scale[scale > 0])[0]
        self.innovations = np.concatenate([record.innovations[record.valid] for record in fit.records])

    def sizes(self) -> Iterator[tuple[Term, float]]:
        """Each term that could show in these data, and how many standard deviations the innovations have of it."""
        in_radians = all(run.record.data.position_unit == "rad" for run in self.runs)
        for term in TERMS:
            if term.code == "ripple" and not in_radians:
                continue
            columns = [run.columns(term) for run in self.runs]
            yield term, self._size(np.concatenate(columns), term.limit)

    def _size(self, columns: Array, limit: float) -> float:
        """√t² as standard deviations of a normal number that is as improbable, for white innovations or for their own colour.

        The colour is looked at only where white innovations would call for the term.
        """
        norms = np.linalg.norm(columns, axis=0)
        rest = columns - self.basis @ (self.basis.T @ columns)
        # What is left of a column that the Jacobian explains is rounding error.
        told = np.isfinite(norms) & (np.linalg.norm(rest, axis=0) > 1e-6 * norms)
        rest = rest[:, told] / norms[told]
        if not rest.shape[1]:
            return 0.0
        total = self.innovations @ rest
        size = _normal_equivalent(total, rest.T @ rest)
        if size <= limit:
            return size
        score = rest * self.innovations[:, None]
        return min(size, _normal_equivalent(total, long_run(score, andrews_lag(score))))


def _normal_equivalent(total: Array, spread: Array) -> float:
    """The normal number that is as improbable as χ² = x' S⁻¹ x, x (K,) with covariance S (K, K)."""
    from scipy.special import chdtrc, ndtri

    chi2 = float(total @ np.linalg.lstsq(spread, total, rcond=1e-9)[0])
    return float(-ndtri(0.5 * max(float(chdtrc(len(total), max(chi2, 0.0))), 1e-300)))


class _Run:
    """One record, simulated once without any term."""

    def __init__(self, fit: Fit, record: FittedRecord, largest: float) -> None:
        data = record.data
        self.fit, self.record, self.largest = fit, record, largest
        self.theta = np.concatenate([fit.model.theta, record.nuisance])
        self.times = np.union1d(data.t_input, data.t_output)
        held = np.searchsorted(data.t_input, self.times, side="right") - 1
        self.u = np.where(held >= 0, data.u[np.maximum(held, 0)], data.input_before)
        self.plain = replace(data, t_input=self.times, u=self.u)
        self.without = fit.model.structure.predict(self.theta, self.plain).y
        self.motion = self._motion()

    def columns(self, term: Term) -> Array:
        """What the term adds to the innovations, as columns (valid, K)."""
        added = []
        if term.to_input is not None:
            for extra in term.to_input(self.motion):
                driven = replace(self.plain, u=self.u + _SMALL * self.largest * extra)
                added.append(self.fit.model.structure.predict(self.theta, driven).y - self.without)
        if term.to_output is not None and self.record.data.kind == "position":
            data = self.record.data
            now = np.searchsorted(self.times, data.t_output)
            added += [data.chain.linear(extra[now], data.t_output) for extra in term.to_output(self.motion)]
        if term.curved in self.fit.model.names:
            added.append(self._curvature(self.fit.model.names.index(term.curved)))
        columns = np.column_stack(added) if added else np.zeros((len(self.without), 1))
        return _in_innovations(self.fit, self.record, columns)

    def _curvature(self, at: int) -> Array:
        """The second derivative of the output by a parameter that is a time, over a tenth of a sample time either way."""
        data, step = self.record.data, np.zeros(len(self.theta))
        step[at] = 0.1 * data.sample_time
        predict = self.fit.model.structure.predict
        after, before = predict(self.theta + step, data).y, predict(self.theta - step, data).y
        return np.asarray((after - 2 * self.record.prediction + before) / step[at] ** 2)

    def _motion(self) -> Motion:
        """The motion as the model simulates it, at the times of the input and the output."""
        data, t = self.record.data, self.times
        if data.kind == "speed":
            speed = np.interp(t, data.t_output, self.record.prediction)
            steps = 0.5 * (speed[1:] + speed[:-1]) * np.diff(t)
            position = np.concatenate([[0.0], np.cumsum(steps)])
        else:
            position = np.interp(t, data.t_output, self.record.prediction)
            speed = np.interp(t, data.t_output, np.gradient(self.record.prediction, data.t_output))
        top = float(np.abs(speed).max(initial=0.0)) or 1.0
        return Motion(
            input=self.u / self.largest,
            speed=speed / top,
            position=position,
            gone=2 * (t - t[0]) / max(float(t[-1] - t[0]), 1e-300) - 1,
        )


def _jacobian(fit: Fit, record: FittedRecord) -> Array:
    theta = np.concatenate([fit.model.theta, record.nuisance])
    return _in_innovations(fit, record, fit.model.structure.predict(theta, record.data).jacobian)


def _in_innovations(fit: Fit, record: FittedRecord, x: Array) -> Array:
    """Columns of the output as columns of the innovations, the valid samples of them."""
    if fit.disturbance is None:
        return np.asarray(x[record.valid] / fit.residual_sd, dtype=np.float64)
    theta = np.concatenate([fit.model.theta, record.nuisance])
    sliding = fit.model.structure.sliding(theta, record.data)
    return whitened(x, record.data, sliding, fit.disturbance)[record.valid]


def _joint(jacobians: list[Array], shared: int) -> Array:
    """The Jacobian of all records: shared parameters in the same columns, each record's own beside them."""
    own = [jacobian.shape[1] - shared for jacobian in jacobians]
    out = np.zeros((sum(len(jacobian) for jacobian in jacobians), shared + sum(own)))
    row, place = 0, shared
    for jacobian, count in zip(jacobians, own, strict=True):
        rows = slice(row, row + len(jacobian))
        out[rows, :shared] = jacobian[:, :shared]
        out[rows, place : place + count] = jacobian[:, shared:]
        row, place = row + len(jacobian), place + count
    return out
