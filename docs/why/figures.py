"""Make the figures of these pages from real runs of the code, and print the numbers that the pages quote.

`python docs/why/figures.py` makes all of them, `python docs/why/figures.py chain` the one that is named. It takes a few minutes.
Records come from the twin: the paper's experiment, or one with a random torque. Every run has a seed, so they come out the same.
"""

import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import servobench as sb
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.estimators.covariance import plain
from servobench.identification.estimators.interval.bins import expected_information
from servobench.identification.estimators.least_squares import Layout, minimise, square_jacobians
from servobench.identification.estimators.least_squares import information as information_of
from servobench.identification.estimators.prediction_error import disturbance_test
from servobench.identification.models.base import STRUCTURES
from servobench.identification.models.nominal import nominal_values
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.rig.devices.base import connect
from servobench.rig.motor.parameters import data_sheet

FOLDER = Path(__file__).resolve().parent
STRUCTURE = STRUCTURES["first_order_one_way"]
MOTOR = replace(data_sheet("qube_servo_2").motor, viscous_friction=1e-6, coulomb_torque=8e-4)
TRUTH = nominal_values(MOTOR)  # of the twin's own parameters, as they stand
QUANTUM = 2 * np.pi / 2048
INK, ACCENT, WARN, MUTED = "#1b1f24", "#0b62a4", "#c2410c", "#6b7280"

Array = NDArray[np.float64]


def record(seed: int, torque: float = 0.0, duration: float = 10.0) -> sb.Recording:
    """The paper's experiment on the twin, begun somewhere in a bin of the encoder and in the square wave's period."""
    random = np.random.default_rng(seed)
    signal = sb.Square(low=1.0, high=3.0, frequency=0.4, phase=float(random.uniform(0.0, 2 * np.pi)))
    start = float(random.uniform(0.0, QUANTUM))
    with connect("twin", torque_noise=torque, start_angle=start) as motor:
        return sb.run(sb.Experiment(signal=signal, duration=duration, sample_time=0.002, seed=seed), motor)


def tau(name: str, data: Dataset) -> float:
    """The relative error of the time constant that an estimator finds, in percent."""
    return 100 * (ESTIMATORS[name].fit(STRUCTURE, [data])["time_constant"].value / TRUTH["time_constant"] - 1)


def chain() -> None:
    """What a filter before the fit does to the time constant, with the filter in the prediction and without it."""
    cutoffs = np.array([10.0, 20.0, 30.0, 50.0, 70.0, 100.0, 150.0, 200.0])
    recording = record(1)
    filtered = [sb.measure(recording, f"derivative | lowpass {cutoff:g} rad/s") for cutoff in cutoffs]
    ignored = [replace(data, applied=Chain()) for data in filtered]
    curves = {
        "63.2 % read off the filtered speed": ([tau("step_63", data) for data in filtered], WARN, "s-"),
        "output error that ignores the chain": ([tau("output_error", data) for data in ignored], MUTED, "^-"),
        "63.2 %, corrected by simulation": (
            [tau("step_63_corrected", data) for data in filtered],
            ACCENT,
            "s--",
        ),
        "output error through the chain": ([tau("output_error", data) for data in filtered], INK, "o-"),
    }
    ax = axes("cut-off of the filter (rad/s)", "error of the time constant (%)")
    for label, (values, colour, style) in curves.items():
        ax.plot(cutoffs, values, style, color=colour, label=label, markersize=4)
        print(f"{label}: " + ", ".join(f"{c:g}: {v:+.3f} %" for c, v in zip(cutoffs, values, strict=True)))
    at_50 = {"ignored": ignored[3], "through": filtered[3]}
    for how, data in at_50.items():
        fit = ESTIMATORS["output_error"].fit(STRUCTURE, [data])
        estimate = fit["time_constant"]
        off = (estimate.value - TRUTH["time_constant"]) / estimate.sd
        print(
            f"{how} at 50 rad/s: {1e3 * estimate.value:.2f} ms, sd {1e3 * estimate.sd:.2g} ms, off by {off:+.1f} sd",
            end="",
        )
        print(f"; delay {1e3 * fit['delay'].value:.2f} ms; fit {fit.fit_percent:.2f} %")
    ax.set_xscale("log")
    ax.set_xticks(cutoffs, [f"{c:g}" for c in cutoffs])
    ax.minorticks_off()
    ax.legend(frameon=False)
    save(ax, "chain")


def readings() -> None:
    """What the readings of steps make of 20 records behind 50/(s + 50), and how often their intervals hold the truth."""
    true = TRUTH["time_constant"]
    datasets = [sb.measure(record(seed), "derivative | lowpass 50 rad/s") for seed in range(20)]
    for name in ("step_63", "step_63_corrected", "log_linear", "log_linear_corrected"):
        found = [ESTIMATORS[name].fit(STRUCTURE, [data])["time_constant"] for data in datasets]
        off = [100 * (estimate.value / true - 1) for estimate in found]
        covers = sum(estimate.interval[0] <= true <= estimate.interval[1] for estimate in found)
        print(f"{name}: mean error {np.mean(off):+.3f} %, scatter {np.std(off):.3f} %, covers {covers} of 20")


def whiteness() -> None:
    """How often Ljung and Box's test at 1 % rejects the residuals of the right model behind an ideal encoder."""
    rejected = 0
    for seed in range(100):
        r = ESTIMATORS["output_error"].fit(STRUCTURE, [sb.measure(record(seed))]).records[0].residual
        e, n = r - r.mean(), len(r)
        rho = np.array([e[lag:] @ e[:-lag] for lag in range(1, 21)]) / (e @ e)
        # 37.57 is the 99 % point of chi squared with 20 degrees of freedom.
        rejected += bool(n * (n + 2) * np.sum(rho**2 / (n - np.arange(1, 21))) > 37.57)
    print(f"rejected {rejected} of 100")


def encoder() -> None:
    """How often the plain 95 % interval of the time constant covers where there is nothing but an ideal encoder's rounding."""
    found = [by_plain(sb.measure(record(seed))) for seed in range(200)]
    covers = np.mean([abs(value - TRUTH["time_constant"]) <= 1.96 * sd for value, sd in found])
    print(f"plain, no torque: covers {100 * covers:.1f} % of 200")


def ratio() -> None:
    """How often the likelihood ratio for a random torque exceeds a value, without one and with a small one."""
    x = np.linspace(0.01, 12.0, 300)
    from scipy.stats import chi2

    ax = axes("likelihood ratio", "part of the records above it")
    ax.plot(x, 0.5 * chi2.sf(x, 1), color=INK, label="½ χ²₀ + ½ χ²₁")
    cases: dict[str, tuple[Callable[[int], Dataset], str]] = {
        "white noise, no torque": (lambda seed: white(sb.measure(record(seed)), seed), ACCENT),
        "encoder and noise of 0.3 count, no torque": (
            lambda seed: noisy(sb.measure(record(seed)), seed),
            MUTED,
        ),
        "ideal encoder, torque of 10⁻⁷ N·m/√Hz": (lambda seed: sb.measure(record(seed, 1e-7)), WARN),
    }
    for label, (make, colour) in cases.items():
        tests = [
            disturbance_test(ESTIMATORS["output_error"].fit(STRUCTURE, [make(seed)])) for seed in range(400)
        ]
        values = np.sort([test.likelihood_ratio for test in tests if test is not None])
        above = 1 - np.arange(1, len(values) + 1) / len(values)
        ax.step(values, above, where="post", color=colour, label=label)
        print(f"{label}: above 2.71 in {100 * np.mean(values > 2.71):.1f} % of {len(values)}", end="; ")
        print(
            f"above 5.41 in {100 * np.mean(values > 5.41):.1f} %; zero in {100 * np.mean(values < 1e-3):.0f} %",
            end="; ",
        )
        print(f"median {np.median(values):.3g}")
    ax.axvline(2.71, color=MUTED, linewidth=1, linestyle=(0, (2, 3)))
    ax.text(2.8, 0.9, "2.71", color=MUTED)
    ax.set(xlim=(0, 12), ylim=(0, 1.02))
    ax.legend(frameon=False, loc="center right")
    save(ax, "ratio")


def white(data: Dataset, seed: int) -> Dataset:
    """The model's own simulation of a record, with white noise as large as the encoder's rounding."""
    fit = ESTIMATORS["output_error"].fit(STRUCTURE, [data])
    noise = QUANTUM / np.sqrt(12) * np.random.default_rng(20_000 + seed).normal(size=len(data.y))
    return replace(data, y=fit.records[0].prediction + noise, quantum=None)


def noisy(data: Dataset, seed: int) -> Dataset:
    """The same record with Gaussian noise of 0.3 count added to the readings."""
    noise = 0.3 * QUANTUM * np.random.default_rng(10_000 + seed).normal(size=len(data.y))
    return replace(data, y=data.y + noise)


def information() -> None:
    """What a count tells of the position, as a bin and as the bin's middle with white noise."""
    levels = np.geomspace(0.02, 1.0, 40)
    inside = (np.arange(4000) + 0.5) / 4000 - 0.5  # positions, spread over a bin of width one
    told = [float(np.mean(expected_information(inside, 1.0, float(s)))) for s in levels]
    as_noise = 1 / (1 / 12 + levels**2)
    ax = axes("noise before rounding (counts)", "information of a sample (1/count²)")
    ax.loglog(levels, told, color=ACCENT, label="the bin that it is")
    ax.loglog(levels, as_noise, color=WARN, label="its middle, with white noise")
    ax.loglog(levels, 1 / levels**2, ":", color=MUTED, label="no rounding at all")
    ax.legend(frameon=False)
    save(ax, "information")
    for s in (0.02, 0.05, 0.1, 0.3):
        n = float(np.mean(expected_information(inside, 1.0, s)))
        middle = 1 / (1 / 12 + s * s)
        print(
            f"{s} count: bin {n:.2f} = {n * s:.3f}/(s Q), middle {middle:.2f}, ratio of sd {np.sqrt(n / middle):.2f}"
        )


def intervals() -> None:
    """The 95 % intervals of the time constant under a random torque, by three rules, for the same records."""
    rules: dict[str, Callable[[Dataset], tuple[float, float]]] = {
        "plain": by_plain,
        "sandwich": lambda data: of(ESTIMATORS["output_error"].fit(STRUCTURE, [data])),
        "prediction error": lambda data: of(ESTIMATORS["prediction_error"].fit(STRUCTURE, [data])),
    }
    datasets = [sb.measure(record(seed, 1e-6)) for seed in range(200)]
    true = TRUTH["time_constant"]
    figure = Figure(figsize=(6.4, 3.0), layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    for ax, (label, rule) in zip(panels, rules.items(), strict=True):
        values, sds = (np.array(column) for column in zip(*(rule(data) for data in datasets), strict=True))
        off, half = 100 * (values / true - 1), 100 * 1.96 * sds / true
        covers = np.abs(off) <= half
        stated, rmse = np.sqrt(np.mean((half / 1.96) ** 2)), np.sqrt(np.mean(off**2))
        print(
            f"{label}: covers {100 * covers.mean():.1f} % of {len(off)}, RMSE {rmse:.4f} %, stated sd {stated:.4f} %"
        )
        for n in range(60):
            ax.plot(
                [n, n], [off[n] - half[n], off[n] + half[n]], color=INK if covers[n] else WARN, linewidth=1
            )
        ax.axhline(0, color=MUTED, linewidth=1)
        ax.set_title(f"{label}: {100 * covers.mean():.0f} % cover", fontsize=8)
        ax.set_xticks([])
        ax.spines[["top", "right", "bottom"]].set_visible(False)
    panels[0].set_ylabel("error of the time constant (%)")
    save(panels[0], "intervals")


def bound() -> None:
    """How the cost rises along a Coulomb voltage of next to nothing, which can't be negative, beside the parabola of its sd."""
    structure = STRUCTURES["first_order_coulomb"]
    signal = sb.Square(low=-3.0, high=3.0, frequency=0.4)
    with connect("twin", coulomb_torque=1e-6, viscous_friction=1e-6) as motor:
        data = sb.measure(
            sb.run(sb.Experiment(signal=signal, duration=10.0, sample_time=0.002, seed=1), motor)
        )
    fit = ESTIMATORS["output_error"].fit(structure, [data])
    theta = np.append(fit.model.theta, fit.records[0].nuisance)
    at = fit.model.names.index("coulomb_voltage")
    least = minimise(structure, [data], theta)
    value, s2 = float(least.theta[at]), least.cost / (len(data.y) - len(theta))
    layout = Layout(structure, (data,))
    h = information_of(layout, square_jacobians(layout, least.predictions))
    sd = float(np.sqrt(s2 * np.linalg.inv(h)[at, at]))
    held = np.linspace(0.0, value + 4 * sd, 30)
    free = np.arange(len(theta)) != at
    rise = []
    for each in held:
        start = least.theta.copy()
        start[at] = each
        rise.append((minimise(structure, [data], start, free).cost - least.cost) / s2)
    low = value - 1.96 * sd
    print(
        f"Coulomb voltage {1e6 * value:.1f} µV (true {1e6 * 1e-6 * 8.4 / 0.042:.1f} µV), sd {1e6 * sd:.1f} µV",
        end="; ",
    )
    top = 1e6 * float(np.interp(1.96**2, rise[int(np.argmin(rise)) :], held[int(np.argmin(rise)) :]))
    print(f"± 1.96 sd is {1e6 * low:.1f} to {1e6 * (value + 1.96 * sd):.1f} µV", end="; ")
    print(f"the profile ends at {top:.1f} µV, and has risen by {rise[0]:.2f} at zero")
    ax = axes("Coulomb voltage (µV)", "rise of the cost, in s²")
    wide = np.linspace(min(low, 0) - 0.5 * sd, held[-1], 100)
    ax.plot(
        1e6 * wide, ((wide - value) / sd) ** 2, "--", color=MUTED, label="parabola of the standard deviation"
    )
    ax.plot(1e6 * held, rise, color=ACCENT, label="profile: all others fitted again")
    ax.axhline(1.96**2, color=MUTED, linewidth=1, linestyle=(0, (2, 3)))
    ax.axvspan(1e6 * wide[0], 0, color="#f1f1f1", linewidth=0)
    ax.text(1e6 * held[-1], 1.96**2 + 0.2, "1.96²", color=MUTED, ha="right")
    ax.legend(frameon=False)
    save(ax, "bound")


def claims() -> None:
    """What explains the paper's 0.13 s: what methods read off its filtered speed, and what causes of a usual size explain."""
    result = sb.identify(sb.measure(record(0), "derivative | lowpass 50 rad/s"))
    found = sb.why(result, ["tau=0.13"], nominal="qube_servo_2")
    print(found)
    figure = Figure(figsize=(7.2, 2.9), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.15, 1))
    readings = sorted(found.readings, key=lambda each: each.time_constant)
    short = {"step_63": "63.2 %", "log_linear": "slope of the logarithm", "rise_time": "10 to 90 %"}
    short |= {"arx": "ARX", "output_error": "fit without the chain"}
    names = ["the motor", *(short[each.method] for each in readings)]
    values = [found.differences[0].data, *(each.time_constant for each in readings)]
    left.axvspan(125, 135, color="#f1f1f1", linewidth=0)
    left.axvline(130, color=WARN, linewidth=1)
    left.text(130, -1.2, "claim: 0.13 s", color=WARN, ha="center", va="bottom")
    for n, (name, value) in enumerate(zip(names, values, strict=True)):
        colour = INK if n == 0 else ACCENT if name == "63.2 %" else MUTED
        left.plot(1e3 * value, n, "o", color=colour)
        side = -1 if 0.11 < value < 0.13 else 1  # clear of the claim
        left.text(
            1e3 * (value + side * 0.002),
            n,
            f"{1e3 * value:.1f}",
            color=colour,
            va="center",
            ha="right" if side < 0 else "left",
        )
        print(f"{name}: {1e3 * value:.2f} ms")
    left.set_yticks(range(len(names)), names)
    left.set(xlabel="time constant (ms)", xlim=(95, 152), ylim=(len(names) - 0.4, -1.1))
    weighed = [each for each in found.causes if each.needed is not None and each.name != "method"]
    for n, each in enumerate(weighed):
        share = 100 * each.explains[0].value
        right.barh(n, share, color=ACCENT if n == 0 else MUTED, height=0.55)
        right.text(share + 2, n, f"{share:.0f} %", va="center", color=INK)
        print(
            f"{each.label}: probability {each.probability:.3f}, explains {share:.1f} %, needed {each.needed}"
        )
    right.set_yticks(
        range(len(weighed)), [f"{each.label} ({100 * each.probability:.0f} %)" for each in weighed]
    )
    right.invert_yaxis()
    right.set(xlabel="explained at its usual size (%)", xlim=(0, 100))
    for ax in (left, right):
        ax.spines[["top", "right"]].set_visible(False)
        ax.tick_params(axis="y", length=0)
    save(left, "claims")


def of(fit: Fit) -> tuple[float, float]:
    return fit["time_constant"].value, fit["time_constant"].sd


def by_plain(data: Dataset) -> tuple[float, float]:
    """Output error's estimate with the standard deviation s² (J'J)⁻¹, right for white residuals alone."""
    minimum = minimise(STRUCTURE, [data], STRUCTURE.guesses([data])[0])
    layout = Layout(STRUCTURE, (data,))
    h = information_of(layout, square_jacobians(layout, minimum.predictions))
    covariance = plain(h, minimum.cost / (len(data.y) - len(minimum.theta)))
    return float(minimum.theta[1]), float(np.sqrt(covariance[1, 1]))


def axes(x: str, y: str) -> mpl.axes.Axes:
    """One pair of axes, labelled."""
    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    ax = figure.subplots()
    ax.set(xlabel=x, ylabel=y)
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def save(ax: mpl.axes.Axes, name: str) -> None:
    """Write the figure as SVG, the same bytes for the same numbers."""
    figure = ax.figure
    figure.savefig(FOLDER / f"{name}.svg", metadata={"Date": None}, facecolor="white")


FIGURES: dict[str, Callable[[], None]] = {
    "chain": chain,
    "readings": readings,
    "whiteness": whiteness,
    "encoder": encoder,
    "ratio": ratio,
    "information": information,
    "intervals": intervals,
    "bound": bound,
    "claims": claims,
}

if __name__ == "__main__":
    mpl.rcParams.update({"font.size": 9, "svg.hashsalt": "servobench", "svg.fonttype": "none"})
    for chosen in sys.argv[1:] or FIGURES:
        print(f"{chosen}:")
        FIGURES[chosen]()
