"""Local fits: the response near a line, free of leakage, and its uncertainty due to noise.

In a window of neighbouring lines the spectrum of the data is

    Y(k) = ρ(k) M(k) U(k) + T(k) + V(k)

with a model M from a preliminary fit, the ratio ρ of the response to it, the transient T, which contains all leakage, and noise
V. ρ is a number for each line that the input excites between quiet ones, or else a parabola along the window; T is a parabola
times the shape of a free motion of M (Pintelon and Schoukens, System Identification, 2nd ed. 2012, chapter 7, the local
polynomial method). There M = 1: the parabolas have to follow the motor itself, and a window of 6 rad/s around a pole at 10
rad/s is off by one part in a hundred. With M near the motor they only have to follow the difference. The result doesn't assume
that M is right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.identification.estimators.spectral.lines import Lines, Stretch
from servobench.identification.estimators.spectral.path import Complex, Path
from servobench.systems.transfer_function import TransferFunction

_DEGREE = 2  # of the parabolas
_QUIET = 15  # lines in a window of separate ones, for three coefficients of T and the noise
_DENSE = 21  # lines in a window without quiet ones, for six coefficients and the noise
_WINDOWS = 150  # without quiet lines, at most; a longer record has wider windows
_POOL = 59.5  # degrees of freedom that a noise level is taken over; they are whole numbers but for rounding
_KNOWN = 1.0  # a ratio with a larger standard deviation isn't known
_UNKNOWN = 1e100  # the variance of what has no column; finite, as it is multiplied by zeros
_NODES = {n: np.polynomial.legendre.leggauss(n)[0] for n in (1, 2, 3)}  # Gauss's points along a window


@dataclass(frozen=True, kw_only=True, eq=False)
class Block:
    """Points from one window, at the frequencies of `path` (m,): the ratio to the model (m,) and its covariance (m, m).

    The covariance E[e e*] is that of circular errors: real and imaginary part have half of it each. `model` (m,) is M there,
    chain and all; `input` (m,) the input's spectrum at the nearest line; `coherence` (m,) the share of the output's power that
    the input made; `width` [rad/s] how far a point looks: a line, or the window.
    """

    path: Path
    ratio: Complex
    covariance: Complex
    model: Complex
    input: Complex
    coherence: Array
    width: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Local:
    """The local fits of one stretch: blocks of points, one from each window.

    `left` (K,) is the spectrum without what the windows explain, `noise` (K,) the noise's power, `leverage` (K,) what share of it
    the fit's own error adds to a line that isn't used. `unknown` counts the points that the input
    excites too little to tell them from nothing.
    """

    stretch: Stretch
    blocks: tuple[Block, ...]
    left: Complex
    noise: Array
    leverage: Array
    unknown: int


@dataclass(frozen=True, eq=False)
class _Window:
    """Lines of a window as places (L,) in the stretch's, those of them that are fitted, and the columns for ρ and T."""

    at: Lines
    used: NDArray[np.bool_]
    ratio: Complex
    transient: Complex
    excited: Lines  # those whose ratio is a column of its own; none where it is a parabola


def local_fits(stretch: Stretch, shape: TransferFunction) -> Local:
    """Return the local fits of a stretch around a preliminary model, from the input to the shaft.

    Raises `NotIdentifiable` where there are fewer lines than a window needs.
    """
    motion = stretch.path.motion(shape)
    model = motion * stretch.path.measured
    free = stretch.path.transient(shape)
    windows = _windows(stretch, model, free / np.abs(free).max())
    white = stretch.path.audible
    first = _solve_stretch(stretch, windows, white)
    noise = _noise_level(first, white, np.abs(motion) ** 2 * white)
    solutions = _solve_stretch(stretch, windows, noise)
    scales = _noise_excess(solutions)
    hidden = _rounding_at_harmonics(stretch, noise, white)
    known = _blocks(stretch, shape, windows, solutions, scales, hidden)
    return Local(
        stretch=stretch,
        blocks=known,
        left=np.concatenate([solution.left for solution in solutions]),
        leverage=np.concatenate([solution.leverage for solution in solutions]),
        noise=noise * np.repeat(scales, [len(window.at) for window in windows]) + hidden,
        unknown=sum(len(solution.ratio) for solution in solutions) - sum(len(block.ratio) for block in known),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Solution:
    """A window's weighted least squares: coefficients of ρ and their covariance for noise of the power `noise` (L,) supposed.

    `left` (L,) is the data without the fit, on unused lines as well; `leverage` (L,) is the fit's variance over the noise's.
    """

    ratio: Complex
    covariance: Complex
    left: Complex
    leverage: Array
    used: NDArray[np.bool_]
    noise: Array

    @property
    def freedom(self) -> float:
        """The number of free complex residuals."""
        return float(np.sum(1.0 - self.leverage[self.used]))

    @property
    def power(self) -> float:
        """The squared residuals over the noise supposed; as large as `freedom` where that is right."""
        return float(np.sum(np.abs(self.left[self.used]) ** 2 / self.noise[self.used]))


def _windows(stretch: Stretch, model: Complex, free: Complex) -> list[_Window]:
    driven, parts = model * stretch.input, _partition(stretch)
    if stretch.separate:
        used = ~np.isin(stretch.lines, stretch.detection)
        return [_separate(stretch, at, used[at], driven, free) for at in parts]
    strong = np.abs(driven) > 1e-6 * np.abs(driven).max()
    return [_smooth(at, int(strong[at].sum()), driven, free) for at in parts]


def _partition(stretch: Stretch) -> list[Lines]:
    """The lines in windows that don't overlap, so that their noise is independent."""
    total = len(stretch.lines)
    quiet = np.ones(total, dtype=bool)
    size = max(_DENSE, int(np.ceil(total / _WINDOWS)))
    if stretch.separate:
        quiet[stretch.excited - 1] = False
        quiet[stretch.detection - 1] = False
        size = _QUIET
    count = int(quiet.sum()) // size
    if count == 0:
        raise NotIdentifiable(
            f"{stretch.data.name}: {int(quiet.sum())} lines of the spectrum show noise only, and at least {size} are "
            "needed: record for longer, or more periods"
        )
    order = np.minimum((np.cumsum(quiet) - 1).clip(0) // size, count - 1)
    return np.split(np.arange(total), np.flatnonzero(np.diff(order)) + 1)


def _separate(
    stretch: Stretch, at: Lines, used: NDArray[np.bool_], driven: Complex, free: Complex
) -> _Window:
    """A ratio for each excited line; what the input has beside these lines goes with the nearest one."""
    lines = stretch.lines[at]
    excited = stretch.excited[(stretch.excited >= lines[0]) & (stretch.excited <= lines[-1])]
    columns = np.zeros((len(at), len(excited)), dtype=np.complex128)
    if len(excited):
        nearest = np.abs(lines[:, None] - excited).argmin(axis=1)
        columns[np.arange(len(at)), nearest] = driven[at]
    return _Window(at, used, columns, _powers(at, _DEGREE) * free[at, None], excited)


def _smooth(at: Lines, strong: int, driven: Complex, free: Complex) -> _Window:
    """A parabola for the ratio, or less where few lines of the window, `strong`, are excited."""
    degree = min(_DEGREE, strong // 3 - 1)
    powers = _powers(at, _DEGREE)
    columns = powers[:, : degree + 1] * driven[at, None]
    return _Window(
        at, np.ones(len(at), dtype=bool), columns, powers * free[at, None], np.empty(0, dtype=np.int64)
    )


def _powers(at: Lines, degree: int) -> Array:
    """x⁰ to x^degree at the lines (L, degree + 1), x from -1 to 1 along the window."""
    half = max(0.5 * (at[-1] - at[0]), 0.5)
    x = (at - 0.5 * (at[0] + at[-1])) / half
    return np.asarray(x[:, None] ** np.arange(degree + 1), dtype=np.float64)


def _solve_stretch(stretch: Stretch, windows: Sequence[_Window], noise: Array) -> list[_Solution]:
    """The solutions of all windows; those of one shape are solved together."""
    shapes: dict[tuple[int, ...], list[int]] = {}
    for n, window in enumerate(windows):
        shapes.setdefault(window.ratio.shape, []).append(n)
    solutions: dict[int, _Solution] = {}
    for places in shapes.values():
        alike = [windows[n] for n in places]
        at = np.array([window.at for window in alike])
        solutions.update(zip(places, _solve(alike, stretch.output[at], noise[at]), strict=True))
    return [solutions[n] for n in range(len(windows))]


def _solve(windows: Sequence[_Window], y: Complex, noise: Array) -> list[_Solution]:
    """The solutions of windows of one shape, whose data are `y` (F, L); a column of zeros has the coefficient zero."""
    columns = np.array([np.hstack([window.ratio, window.transient]) for window in windows])
    weight = np.array([window.used for window in windows]) / np.sqrt(noise)
    a = columns * weight[:, :, None]
    size = np.sqrt(np.sum(np.abs(a) ** 2, axis=1))
    absent = size == 0
    size[absent] = 1.0
    q, triangle = np.linalg.qr(a / size[:, None, :])
    back = np.linalg.pinv(triangle, rcond=1e-12) / size[:, :, None]
    linear = back @ (_adjoint(q) @ (y * weight)[:, :, None])
    covariance = back @ _adjoint(back)
    diagonal = np.arange(size.shape[1])
    covariance[:, diagonal, diagonal] += np.where(absent, _UNKNOWN, 0.0)
    left = y - (columns @ linear)[:, :, 0]
    leverage = np.sum(np.abs(columns @ back) ** 2, axis=2) / noise
    count = windows[0].ratio.shape[1]
    return [
        _Solution(
            ratio=linear[n, :count, 0], covariance=covariance[n, :count, :count], left=left[n],
            leverage=leverage[n], used=window.used, noise=noise[n],
        )
        for n, window in enumerate(windows)
    ]  # fmt: skip


def _adjoint(stack: Complex) -> Complex:
    """The conjugate transposes (F, C, R) of matrices (F, R, C)."""
    return stack.conj().swapaxes(1, 2)


def _noise_level(solutions: Sequence[_Solution], white: Array, driven: Array) -> Array:
    """The power of the noise (K,), r · white + q · driven: noise of the sensor, and a random torque, which moves the motor.

    Their ratio is the likeliest of some for the residuals, whose powers are exponentially distributed about their expectation.
    """
    left = np.concatenate([s.left for s in solutions])
    free = np.concatenate([1.0 - s.leverage for s in solutions])
    use = np.concatenate([s.used for s in solutions]) & (free > 0.1)
    power = np.abs(left[use]) ** 2 / free[use]
    white = white / white[use].mean()
    driven = driven / driven[use].mean()
    best, level = np.inf, white
    for part in [0.0, *np.logspace(-8, 0, 33)]:
        shape = (1.0 - part) * white + part * driven
        size = float(np.mean(power / shape[use]))
        cost = len(power) * np.log(max(size, 1e-300)) + float(np.sum(np.log(shape[use])))
        if cost < best:
            best, level = cost, size * shape
    return np.maximum(level, 1e-300)


def _noise_excess(solutions: Sequence[_Solution]) -> Array:
    """The noise around each window over the noise supposed, over as many windows as it takes to know that well."""
    freedom = np.array([s.freedom for s in solutions])
    power = np.array([s.power for s in solutions])
    scales = np.empty(len(solutions))
    sums = np.concatenate([[0.0], np.cumsum(freedom)]), np.concatenate([[0.0], np.cumsum(power)])
    for n in range(len(solutions)):
        reach = 0
        low, high = n, n + 1
        while sums[0][high] - sums[0][low] < _POOL and (low > 0 or high < len(solutions)):
            reach += 1
            low, high = max(n - reach, 0), min(n + reach + 1, len(solutions))
        scales[n] = (sums[1][high] - sums[1][low]) / max(sums[0][high] - sums[0][low], 1e-300)
    return np.maximum(scales, 1e-300)


def _rounding_at_harmonics(stretch: Stretch, noise: Array, white: Array) -> Array:
    """The rounding noise at the harmonics of the period only, at most, (K,).

    Where the motion repeats to a fraction of a count, so does its rounding: then it isn't seen between the harmonics. Its power
    is a twelfth of a count squared all the same, and what isn't seen is spread over the harmonics.
    """
    quantum = stretch.data.quantum
    if quantum is None or stretch.cycles < 2:
        return np.zeros(len(noise))
    level = float(np.mean(noise / white))
    return np.asarray(white * max(quantum**2 / 12 - level, 0.0) * stretch.cycles, dtype=np.float64)


def _points(stretch: Stretch, window: _Window, count: int) -> tuple[Array, Array]:
    """Frequencies (m,) [rad/s] of a window's points, and what the coefficients of ρ are multiplied with there, (m, count)."""
    spacing = stretch.path.omega[0]
    if stretch.separate:
        omega = spacing * window.excited if stretch.tone is None else np.full(count, stretch.tone)
        return omega, np.eye(count)
    # At Gauss's points the values of a fitted parabola don't depend on each other, where all lines count the same.
    nodes = _NODES[count]
    middle, half = 0.5 * (window.at[0] + window.at[-1]), 0.5 * (window.at[-1] - window.at[0])
    return spacing * (1 + middle + half * nodes), nodes[:, None] ** np.arange(count)


def _blocks(
    stretch: Stretch,
    shape: TransferFunction,
    windows: Sequence[_Window],
    solutions: Sequence[_Solution],
    scales: Array,
    hidden: Array,
) -> tuple[Block, ...]:
    """The points of all windows that have some."""
    some = [n for n, solution in enumerate(solutions) if len(solution.ratio)]
    if not some:
        return ()
    points = [_points(stretch, windows[n], len(solutions[n].ratio)) for n in some]
    # The model at the points of all windows at once: what it takes to prepare is the same for each.
    path = replace(stretch.path, omega=np.concatenate([omega for omega, _ in points]))
    models = np.split(path.full(shape), np.cumsum([len(omega) for omega, _ in points])[:-1])
    blocks = [
        _block(stretch, windows[n], solutions[n], float(scales[n]), hidden, omega, basis, model)
        for n, (omega, basis), model in zip(some, points, models, strict=True)
    ]
    return tuple(block for block in blocks if block is not None)


def _block(
    stretch: Stretch,
    window: _Window,
    solution: _Solution,
    scale: float,
    hidden: Array,
    omega: Array,
    basis: Array,
    model: Complex,
) -> Block | None:
    """The points of a window, at `omega`, without those that the data say nothing of; None where there are none."""
    near = np.abs(stretch.path.omega[window.at] - omega[:, None]).argmin(
        axis=1
    )  # the nearest line of the window
    at = window.at[near]
    driven = np.abs(model * stretch.input[at]) ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        covariance = scale * (basis @ solution.covariance @ basis.T) + np.diag(hidden[at] / driven)
        known = np.flatnonzero(0.5 * np.diag(covariance).real < _KNOWN**2)
    if not len(known):
        return None
    ratio = basis @ solution.ratio
    made = np.abs(ratio) ** 2 * _power_of_input(stretch, window, np.abs(model) ** 2, at)
    return Block(
        path=replace(stretch.path, omega=omega[known]),
        ratio=ratio[known],
        covariance=covariance[np.ix_(known, known)],
        model=model[known],
        input=stretch.input[at[known]],
        coherence=(made / (made + scale * solution.noise[near] + hidden[at]))[known],
        width=float(stretch.path.omega[0] * (1 if stretch.separate else len(window.at))),
    )


def _power_of_input(stretch: Stretch, window: _Window, gain: Array, at: Lines) -> Array:
    """The power that the model makes of the input at points (m,): at their own line, or on average over the window."""
    if stretch.separate:
        return np.asarray(gain * np.abs(stretch.input[at]) ** 2, dtype=np.float64)
    return np.asarray(gain * np.mean(np.abs(stretch.input[window.at]) ** 2), dtype=np.float64)
