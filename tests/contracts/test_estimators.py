"""An estimator does all that it declares; anything else it refuses, or says that it left it out.

Data and structure are chosen by the declaration, so a new member is covered by being there. The true motor is first-order, exact:
closed forms between events, or the reference motor where there is friction or a random torque.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.core.errors import NotIdentifiable
from servobench.core.rounding import TWO_SIDED
from servobench.identification.estimators.base import ESTIMATORS, Abilities, Estimator, Fit
from servobench.identification.models.base import STRUCTURES
from servobench.identification.uncertainty.bands import frequency_band
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Source
from tests.rig.motor.reference import Truth, march

ROOT = Path(__file__).resolve().parent.parent.parent
GAIN, TAU, LOST = 20.0, 0.1, 0.2
STEP, SAMPLES = 0.005, 2000
QUANTUM = 2 * np.pi / 20_000
SPEED_NOISE = 0.05  # rad/s
FILTER = Chain.parse("derivative | lowpass 50 rad/s")

# In stated standard deviations, so that chance won't do: 1 in 1.7 million for a normal, 1 in 400 for the few steps of a reading.
DEVIATIONS = 5.0
# What a reading of steps may be off beside that: (T/τ)²/8 = 3e-4 for straight lines between samples, 10 e^-10 = 5e-4 for what
# hasn't settled where a slope ends at a tenth, 1e-4 for the logarithm of noise there.
SLACK = 9e-4
# However wide an interval is stated, no more than this is let through: noise of 0.05 rad/s moves the 63.2 % of a step of 40 rad/s
# by e 0.05/40 = 0.34 % of τ, and five standard deviations of the mean over 7 steps are 0.64 %. A filter of 20 ms that is left out
# costs 1.2 % of the magnitude at the pole and 2.1 % above it, even where a free delay takes up most of it.
CEILING = 0.01

Array = NDArray[np.float64]
POLES: Array = np.array([0.1, 1.0, 3.0]) / TAU  # rad/s: below, at and above the motor's pole


def square(t: Array, low: float = 1.0, high: float = 3.0) -> Array:
    return np.where(np.floor(t / 1.25 + 1e-9) % 2 == 0, high, low)


def multisine(t: Array) -> Array:
    """Ten seconds of odd harmonics of 0.1 Hz up to 4.9 Hz, between 1 and 3 V, with Schroeder's phases."""
    n = np.arange(1, 50, 2)
    phases = -np.pi * np.arange(len(n)) * (np.arange(len(n)) + 1) / len(n)
    x = np.cos(2 * np.pi * 0.1 * np.outer(t, n) + phases).sum(axis=1)
    return np.asarray(2.0 + x / np.abs(x).max(), dtype=np.float64)


@dataclass(frozen=True)
class Excitation:
    """The motor's excitation: a signal in volts, or one in radians that a proportional controller of the position follows."""

    signal: Callable[[Array], Array]
    controlled: bool = False


CLOSED = Excitation(lambda t: square(t, 0.0, 3.0), controlled=True)
EXCITATIONS = (Excitation(square), Excitation(multisine), CLOSED)
PROPORTIONAL = 2.0  # V/rad


def motion(t_in: Array, u: Array, t_out: Array, delay: float) -> tuple[Array, Array]:
    """Position and speed at t_out of τ dω/dt = -ω + K (u(t - d) - u₀), in closed form from event to event."""
    events = np.union1d(t_out, t_in + delay)
    held = np.searchsorted(t_in + delay, events, side="right") - 1
    drive = GAIN * (np.append(u, u[0])[held] - LOST)
    angle, speed = np.empty(len(events)), np.empty(len(events))
    angle[0], speed[0] = 0.1, drive[0]
    for k, h in enumerate(np.diff(events)):
        fall = -np.expm1(-h / TAU)
        angle[k + 1] = angle[k] + drive[k] * h + TAU * fall * (speed[k] - drive[k])
        speed[k + 1] = speed[k] + fall * (drive[k] - speed[k])
    here = np.searchsorted(events, t_out)
    return angle[here], speed[here]


def controlled(reference: Array, delay: float, noise: Array) -> Array:
    """The input of the same motor under u = P (r - y), y the encoder's reading with noise (in counts), in closed form."""
    whole, rest = int(delay // STEP), delay % STEP
    u, angle, speed = np.zeros(SAMPLES), 0.1, GAIN * (0.0 - LOST)
    for k in range(SAMPLES):
        u[k] = PROPORTIONAL * (reference[k] - reading(angle, noise[k]))
        for h, n in ((rest, k - whole - 1), (STEP - rest, k - whole)):
            end, fall = GAIN * (u[max(n, 0)] - LOST), -np.expm1(-h / TAU)
            angle, speed = angle + end * h + TAU * fall * (speed - end), speed + fall * (end - speed)
    return u


def reading(angle: Array | float, noise: Array | float) -> Array:
    return np.asarray((np.floor(np.asarray(angle) / QUANTUM + noise) + 0.5) * QUANTUM)


def dataset(
    *,
    kind: str = "position",
    by: Excitation = EXCITATIONS[0],
    irregular: bool = False,
    chain: Chain | None = None,
    delay: float = 0.0,
    seed: int = 1,
    turned: float = 0.0,
) -> Dataset:
    """The motor's position from an encoder that is `turned` [rad], or its speed with a little white noise, or behind a chain."""
    random = np.random.default_rng(seed)
    t_in = STEP * np.arange(SAMPLES)
    noise = 0.1 * random.normal(size=SAMPLES)
    u = controlled(by.signal(t_in), delay, noise) if by.controlled else by.signal(t_in)
    t_out = t_in
    if irregular:
        t_out = np.sort(random.uniform(0.0, t_in[-1], SAMPLES - 1))
        t_out = np.concatenate([[0.0], t_out[np.diff(t_out, prepend=0.0) > 1e-4]])
    angle, speed = motion(t_in, u, t_out, delay)
    angle += turned
    data = packed(t_in, u, t_out, angle, speed, kind, chain or Chain(), noise[: len(t_out)])
    return replace(data, reference=by.signal(t_in)) if by.controlled else data


def packed(
    t_in: Array, u: Array, t_out: Array, angle: Array, speed: Array, kind: str, chain: Chain, noise: Array
) -> Dataset:
    """A dataset whose position has that noise in counts before it is rounded, and whose speed has it in a tenth of 0.5 rad/s."""
    y = reading(angle, noise) if kind == "position" else speed + SPEED_NOISE / 0.1 * noise
    what = "speed" if kind == "speed" or chain else "position"
    return Dataset(
        name="motor", t_input=t_in, u=u, input_unit="V", input_before=float(u[0]), t_output=t_out, y=chain(y, t_out),
        output_unit="rad" if what == "position" else "rad/s", kind=what, source=Source(name="motor"),
        quantum=QUANTUM if what == "position" else None, applied=chain,
    )  # fmt: skip


def preferred(can: Abilities) -> str:
    """The data on which the estimator works best: a position if it can."""
    return "position" if can.position else "speed"


# The structures that the true motor belongs to, without friction and with it.
STRUCTURES_OF_IT = {
    False: ("first_order_one_way", "first_order", "rational_1_0_integrator_delay"),
    True: ("first_order_coulomb",),
}


def fitted(estimator: Estimator, data: Sequence[Dataset], friction: bool = False) -> Fit:
    """The fit of the first structure that the estimator supports; the refusals where it supports none."""
    refusals = []
    for structure in (STRUCTURES[name] for name in STRUCTURES_OF_IT[friction]):
        lacking = estimator.supports(structure, data)
        if lacking is None:
            return estimator.fit(structure, data)
        refusals.append(lacking.sentence)
    raise NotIdentifiable(" ".join(refusals))


def fitted_to_some(estimator: Estimator, make: Callable[[Excitation], list[Dataset]]) -> Fit:
    """The fit to the first excitation that suits the estimator; `NotIdentifiable` with all its reasons where none does."""
    reasons = []
    for by in EXCITATIONS:
        try:
            return fitted(estimator, make(by))
        except NotIdentifiable as error:
            reasons.append(str(error))
    raise NotIdentifiable(" ".join(reasons))


def check_near(found: Fit, gain: float = GAIN, tau: float = TAU) -> None:
    """Magnitudes below, at and above the pole: between them they fix gain and time constant, in any structure's parameters."""
    omega = POLES * TAU / tau
    band = frequency_band(found, omega)
    off = np.log(band.magnitude / (gain / np.hypot(1.0, omega * tau)))
    allowed = np.minimum(DEVIATIONS * band.magnitude_half / TWO_SIDED + SLACK, CEILING)
    assert np.all(np.abs(off) <= allowed), (
        f"{found.estimator}, {found.structure}: off by {off}, allowed {allowed}"
    )


CAN = {name: ESTIMATORS[name].abilities for name in ESTIMATORS.names()}


def those_that(ability: str, able: bool = True) -> list[str]:
    return [name for name, can in CAN.items() if getattr(can, ability) is able]


@pytest.mark.parametrize("name", CAN)
def test_an_estimator_says_what_it_is_in_words(name: str) -> None:
    can = CAN[name]
    assert isinstance(ESTIMATORS[name], Estimator)
    assert all(text and not text.endswith(".") for text in (can.method, can.noise, can.interval))
    assert can.position or can.speed


@pytest.mark.parametrize(
    ("name", "kind"), [(name, kind) for kind in ("position", "speed") for name in those_that(kind)]
)
def test_position_and_speed(name: str, kind: str) -> None:
    check_near(fitted_to_some(ESTIMATORS[name], lambda by: [dataset(kind=kind, by=by)]))


@pytest.mark.parametrize("name", CAN)
def test_intervals_are_as_wide_as_the_errors_are_large(name: str) -> None:
    """Errors in stated standard deviations, of records with another noise and another rounding each: their mean square is 1.

    Twelve squares of a standard normal add up to between 0.63 and 50.8 but for 1 in 1,000,000 either way.
    """
    square_sums = np.zeros(3)
    for seed in range(12):
        turned = float(np.random.default_rng(seed).uniform(0.0, QUANTUM))
        found = fitted_to_some(
            ESTIMATORS[name],
            lambda by, seed=seed, turned=turned: [  # type: ignore[misc]
                dataset(kind=preferred(CAN[name]), by=by, seed=seed, turned=turned)
            ],
        )
        band = frequency_band(found, POLES)
        off = np.log(band.magnitude / (GAIN / np.hypot(1.0, POLES * TAU)))
        square_sums += (off / (band.magnitude_half / TWO_SIDED)) ** 2
    assert np.all((square_sums > 0.63) & (square_sums < 50.8)), square_sums


@pytest.mark.parametrize("name", those_that("chain"))
def test_a_filter_is_not_taken_for_the_motor(name: str) -> None:
    check_near(fitted_to_some(ESTIMATORS[name], lambda by: [dataset(chain=FILTER, by=by)]))


@pytest.mark.parametrize("name", those_that("irregular_times"))
def test_irregular_times(name: str) -> None:
    kind = preferred(CAN[name])
    check_near(fitted_to_some(ESTIMATORS[name], lambda by: [dataset(kind=kind, by=by, irregular=True)]))


@pytest.mark.parametrize("name", those_that("several_records"))
def test_several_records_share_the_parameters(name: str) -> None:
    kind = preferred(CAN[name])
    found = fitted_to_some(
        ESTIMATORS[name], lambda by: [dataset(kind=kind, by=by, seed=seed) for seed in (1, 2)]
    )
    assert len(found.records) == 2
    check_near(found)


@pytest.mark.parametrize("name", those_that("delay"))
def test_a_delay_that_is_no_whole_number_of_samples(name: str) -> None:
    kind, delay = preferred(CAN[name]), 1.3 * STEP
    found = fitted_to_some(ESTIMATORS[name], lambda by: [dataset(kind=kind, by=by, delay=delay)])
    check_near(found)
    # A tenth of a sample is what a reading of the delay is good for; a delay in whole samples would be 0.3 of one off.
    assert abs(found["delay"].value - delay) <= DEVIATIONS * found["delay"].sd + 0.01 * STEP


@pytest.mark.parametrize("name", those_that("closed_loop"))
def test_noise_that_is_fed_back_makes_no_bias(name: str) -> None:
    check_near(fitted(ESTIMATORS[name], [dataset(by=CLOSED)]))


COULOMB = Truth(inductance=1e-9, viscous_friction=5e-6)


def reversing(kind: str) -> Dataset:
    """The reference motor with Coulomb friction, turned to and fro by ±3 V."""
    t = STEP * np.arange(SAMPLES)
    u = square(t, -3.0, 3.0)
    state = march(COULOMB, u, STEP)
    random = np.random.default_rng(4)
    return replace(
        packed(t, u, t, state[:, 2], state[:, 1], kind, Chain(), 0.1 * random.normal(size=SAMPLES)),
        input_before=0.0,
    )


def gain_and_time_constant(motor: Truth) -> tuple[float, float]:
    r, _, k, j, b, _ = motor
    return k / (r * b + k * k), j * r / (r * b + k * k)


@pytest.mark.parametrize("name", those_that("friction"))
def test_friction_with_reversals(name: str) -> None:
    found = fitted(ESTIMATORS[name], [reversing(preferred(CAN[name]))], friction=True)
    check_near(found, *gain_and_time_constant(COULOMB))
    lost = COULOMB.coulomb_torque * COULOMB.resistance / COULOMB.motor_constant
    assert found["coulomb_voltage"].value == pytest.approx(
        lost, abs=DEVIATIONS * found["coulomb_voltage"].sd + SLACK * lost
    )


@pytest.mark.parametrize("name", those_that("disturbance"))
def test_a_random_torque(name: str) -> None:
    """Its level: ten times what the encoder shows, so that an interval for white measurement noise would be far too narrow."""
    motor = COULOMB._replace(coulomb_torque=0.0)
    t = STEP * np.arange(SAMPLES)
    u = square(t)
    state = march(motor, u, STEP, step=5e-5, torque_noise=1e-6, seed=3)
    data = packed(
        t,
        u,
        t,
        state[:, 2],
        state[:, 1],
        preferred(CAN[name]),
        Chain(),
        0.1 * np.random.default_rng(5).normal(size=SAMPLES),
    )
    found = fitted(ESTIMATORS[name], [data])
    assert found.disturbance is not None
    check_near(found, *gain_and_time_constant(motor))


def told_of(name: str, data: Sequence[Dataset], friction: bool = False) -> str:
    """The estimator's answer to data for which it doesn't declare an ability: its refusals, or its fit's findings."""
    try:
        return " ".join(finding.sentence for finding in fitted(ESTIMATORS[name], data, friction).findings)
    except NotIdentifiable as error:
        return str(error)


# What data show that they need, and the words that name it. (A loop that is closed, a delay and a random torque don't show.)
NAMED: dict[str, tuple[str, Callable[[str], list[Dataset]]]] = {
    "position": ("position", lambda _kind: [dataset(kind="position")]),
    "speed": ("speed", lambda _kind: [dataset(kind="speed")]),
    "chain": ("measurement chain", lambda _kind: [dataset(chain=FILTER)]),
    "irregular_times": ("irregular times", lambda kind: [dataset(kind=kind, irregular=True)]),
    "several_records": ("several records", lambda kind: [dataset(kind=kind, seed=seed) for seed in (1, 2)]),
    "friction": ("friction", lambda kind: [reversing(kind)]),
}


@pytest.mark.parametrize(
    ("name", "ability"), [(name, ability) for ability in NAMED for name in those_that(ability, able=False)]
)
def test_what_an_estimator_does_not_declare_it_names(name: str, ability: str) -> None:
    words, make = NAMED[ability]
    assert words in told_of(name, make(preferred(CAN[name])), friction=ability == "friction")


@pytest.mark.parametrize("name", those_that("delay", able=False))
def test_a_delay_that_is_not_estimated_has_no_interval_and_is_named(name: str) -> None:
    """No data show beforehand that they need a delay, so this is told with the fit."""
    found = fitted_to_some(ESTIMATORS[name], lambda by: [dataset(kind=preferred(CAN[name]), by=by)])
    assert "delay" in " ".join(finding.sentence for finding in found.findings)
    assert "delay" not in found.model.names or np.isinf(found["delay"].sd)


@pytest.mark.parametrize("name", CAN)
def test_the_name_in_a_fit_is_the_estimators_own(name: str) -> None:
    found = fitted_to_some(ESTIMATORS[name], lambda by: [dataset(kind=preferred(CAN[name]), by=by)])
    assert found.estimator == name
    assert STRUCTURES[found.structure] is found.model.structure
    assert found.covariance.shape == (len(found.model.theta),) * 2


def write_which_estimator() -> ModuleType:
    """Import the tool, which is no part of the package."""
    spec = importlib.util.spec_from_file_location(
        "write_which_estimator", ROOT / "tools" / "write_which_estimator.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_on_estimators_is_what_they_declare() -> None:
    stored = (ROOT / "docs" / "which-estimator.md").read_text(encoding="utf-8")
    assert stored == write_which_estimator().page(), "run make generate"


def test_the_page_says_so_where_a_cost_is_not_measured(tmp_path: Path) -> None:
    tool = write_which_estimator()
    table = tmp_path / "cost.json"
    table.write_text(
        '{"output_error": 0.0012, "date": "2026-01-02", "machine": "a machine"}', encoding="utf-8"
    )

    rows = {line.split("`")[1]: line for line in tool.page(table).splitlines() if line.startswith("| [`")}

    assert set(rows) == set(CAN)
    assert rows["output_error"].endswith("| 1.2\u00a0ms |")
    assert rows["step_63"].endswith("| not measured |")
    assert "Not measured yet" in tool.page(tmp_path / "none.json")
