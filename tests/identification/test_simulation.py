"""Truth: SciPy's `lsim` of the same system, a plain Kalman filter with matrices, and the motor marched in small steps."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
import scipy.signal

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable, UsageError
from servobench.identification.estimators.disturbance import Disturbance
from servobench.identification.estimators.output_error import OutputError
from servobench.identification.estimators.prediction_error import PredictionError
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES, Model
from servobench.identification.simulation import predict, residuals, simulate
from servobench.identification.trust.held_out import validate_with
from servobench.recordings.measurement.dataset import Dataset
from servobench.systems.signals.square import Square
from tests.datasets import QUANTUM, dataset
from tests.rig.motor.reference import Truth

GAIN, TAU, STEP = 23.8, 0.1, 0.01
T = np.arange(300) * STEP
DRIVE = np.random.default_rng(7).choice([-3.0, 0.0, 2.0], len(T))


def model(delay: float = 0.0, offset: float = 0.0, friction: float = 0.0) -> Model:
    """The first-order motor with a Coulomb voltage; one without any friction where that is zero."""
    data = dataset(seed=1, samples=10)
    if friction:
        theta = np.array([GAIN, TAU, friction, offset, delay])
        return Model(structure=STRUCTURES["first_order_coulomb"], theta=theta, data=data)
    return Model(structure=STRUCTURES["first_order"], theta=np.array([GAIN, TAU, offset, delay]), data=data)


def lsim(numerator: list[float], denominator: list[float], t: Array, u: Array) -> Array:
    """The response of a rational system to a held input, at rest at first."""
    response = scipy.signal.lsim((numerator, denominator), u, t, interp=False)
    return np.asarray(response[1], dtype=np.float64)


def test_a_motor_without_friction_or_delay_does_what_lsim_says() -> None:
    # Both are exact for a held input: rounding is all that's left.
    np.testing.assert_allclose(simulate(model(), DRIVE, T), lsim([GAIN], [TAU, 1.0], T, DRIVE), atol=1e-10)
    np.testing.assert_allclose(
        simulate(model(), DRIVE, T, output="position"), lsim([GAIN], [TAU, 1.0, 0.0], T, DRIVE), atol=1e-10
    )


def test_a_delay_of_a_part_of_a_sample_is_exact() -> None:
    # On a grid four times as fine a delay of 1.75 samples is seven of its steps.
    fine = np.arange(4 * len(T)) * STEP / 4
    late = np.concatenate([np.zeros(7), np.repeat(DRIVE, 4)[:-7]])

    np.testing.assert_allclose(
        simulate(model(delay=1.75 * STEP), DRIVE, T), lsim([GAIN], [TAU, 1.0], fine, late)[::4], atol=1e-9
    )


def test_an_offset_is_taken_from_the_input_from_the_beginning() -> None:
    np.testing.assert_allclose(
        simulate(model(offset=0.3), DRIVE, T), lsim([GAIN], [TAU, 1.0], T, DRIVE - 0.3), atol=1e-10
    )


def test_friction_holds_the_shaft_until_the_input_beats_it() -> None:
    ramp = np.linspace(0, 1, len(T))

    speed = simulate(model(friction=0.5), ramp, T)

    assert np.all(speed[ramp <= 0.5] == 0)
    assert np.all(speed[1:][ramp[:-1] > 0.5] > 0)


def test_a_chain_gives_what_it_makes_of_the_bare_output() -> None:
    from servobench.recordings.measurement.base import Chain

    chain = Chain.parse("derivative | lowpass 50 rad/s")
    bare = simulate(model(), DRIVE, T, output="position")

    through = simulate(model(), DRIVE, T, output="position", chain="derivative | lowpass 50 rad/s")

    np.testing.assert_allclose(through, chain(bare, T), atol=1e-9)


def test_a_signal_is_its_values_at_the_times() -> None:
    signal = Square(low=-1.0, high=2.0, frequency=1.3)

    np.testing.assert_array_equal(simulate(model(), signal, T), simulate(model(), signal(T), T))


def test_irregular_times_give_the_same_as_a_grid_that_holds_them() -> None:
    some = np.sort(np.random.default_rng(3).choice(len(T), 60, replace=False))
    held = DRIVE[some][np.searchsorted(some, np.arange(len(T)), side="right") - 1]
    held[: some[0]] = 0.0

    np.testing.assert_allclose(
        simulate(model(), DRIVE[some], T[some]), simulate(model(), held, T)[some], atol=1e-10
    )


def test_a_start_is_carried_on_from() -> None:
    whole = simulate(model(), DRIVE, T, output="position")
    speed = simulate(model(), DRIVE, T)
    cut = 120

    rest = simulate(
        model(), DRIVE[cut:], T[cut:], output="position", start={"start_position": whole[cut], "start_speed": speed[cut]}
    )  # fmt: skip

    np.testing.assert_allclose(rest, whole[cut:], atol=1e-9)


def test_a_dataset_s_own_input_times_and_chain_are_used() -> None:
    data = dataset(seed=4, samples=1500, chain="derivative | lowpass 50 rad/s")

    np.testing.assert_allclose(
        simulate(model(), data),
        simulate(model(), data.u, data.t_input, output="position", chain=data.applied),
        atol=1e-9,
    )


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"drive": DRIVE}, "without times"),
        ({"drive": DRIVE, "t": T[:-1]}, "values of shape"),
        ({"drive": DRIVE, "t": T, "start": {"start_angle": 1.0}}, "'start_angle'.*start_speed"),
        ({"drive": dataset(seed=1, samples=10), "t": T}, "brings its own"),
        ({"drive": dataset(seed=1, samples=10), "chain": "derivative"}, "brings its own"),
        ({"drive": DRIVE, "t": T, "chain": "derivative"}, "derivative"),  # of a speed
    ],
)
def test_what_doesn_t_go_together_is_refused_by_name(arguments: dict[str, object], sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        simulate(model(), **arguments)  # type: ignore[arg-type]


def test_a_refused_result_simulates_and_predicts_nothing() -> None:
    still = dataset(seed=1, samples=200)
    result = identify(replace(still, u=np.zeros(200), y=np.full(200, 1.0)))

    for use in (
        lambda: simulate(result, DRIVE, T),
        lambda: predict(result, still),
        lambda: residuals(result),
    ):
        with pytest.raises(NotIdentifiable, match="has no model"):
            use()


def test_without_a_noise_model_the_prediction_is_the_simulation_from_the_fitted_start() -> None:
    data, other = dataset(seed=1, samples=2000), dataset(seed=2, samples=2000)
    fit = OutputError().fit(STRUCTURES["first_order_one_way"], [data])

    np.testing.assert_array_equal(predict(fit, data), fit.records[0].prediction)
    (left,) = residuals(fit)
    np.testing.assert_array_equal(left, data.y - predict(fit, data))
    # Of another record only the start is fitted; what remains is the rounding of the encoder.
    assert np.std(other.y - predict(fit, other)) < 1.1 * QUANTUM / np.sqrt(12)


def kalman(data: Dataset, simulation: Array, noise: Disturbance) -> Array:
    """One-step predictions by the textbook's matrices: the transition by `expm`, the noise of a step by Van Loan's block."""
    a, q = np.array([[0.0, 1.0], [0.0, -1 / noise.tau]]), noise.ratio * noise.variance
    step = data.sample_time
    block = np.zeros((4, 4))
    block[:2, :2], block[2:, 2:], block[1, 3] = -a, a.T, q
    exponential = scipy.linalg.expm(block * step)
    transition = exponential[2:, 2:].T
    added = transition @ exponential[:2, 2:]
    h = np.array([[1.0, 0.0]])
    state, p, predicted = np.zeros((2, 1)), np.zeros((2, 2)), np.empty(len(data.y))
    for k, y in enumerate(data.y - simulation):
        predicted[k] = simulation[k] + state[0, 0]
        gain = p @ h.T / (h @ p @ h.T + noise.variance)
        state = transition @ (state + gain * (y - state[0, 0]))
        p = transition @ (p - gain @ h @ p) @ transition.T + added
    return predicted


@pytest.fixture(scope="module")
def disturbed() -> tuple[Dataset, Dataset]:
    return dataset(seed=5, samples=2500, torque_noise=1e-5), dataset(seed=6, samples=2500, torque_noise=1e-5)


def test_with_a_disturbance_it_is_the_kalman_filter_of_the_textbook(
    disturbed: tuple[Dataset, Dataset],
) -> None:
    fit = PredictionError().fit(STRUCTURES["first_order_one_way"], [disturbed[0]])
    assert fit.disturbance is not None

    predicted = predict(fit, disturbed[0])

    expected = kalman(disturbed[0], fit.records[0].prediction, fit.disturbance)
    np.testing.assert_allclose(predicted, expected, atol=1e-9)


def test_a_disturbed_motor_is_predicted_far_better_than_it_is_simulated(
    disturbed: tuple[Dataset, Dataset],
) -> None:
    fit = PredictionError().fit(STRUCTURES["first_order_one_way"], [disturbed[0]])

    own = np.std(residuals(fit)[0])
    other = np.std(disturbed[1].y - predict(fit, disturbed[1]))
    wandered = np.std(disturbed[1].y - simulated(fit.model, disturbed[1]))

    # A torque of the same intensity: of 2500 innovations a standard deviation is known to 1/√5000 = 1.4 %, twice; five of them.
    assert other == pytest.approx(own, rel=0.1)
    assert other < 0.1 * wandered


def simulated(model: Model, data: Dataset) -> Array:
    return simulate(model, data, start={"start_position": float(data.y[0])})


def test_the_other_record_s_start_is_fitted_under_the_noise_model(disturbed: tuple[Dataset, Dataset]) -> None:
    # Shifted and still turning at first: nothing but the start differs, and it is found.
    fit = PredictionError().fit(STRUCTURES["first_order_one_way"], [disturbed[0]])
    later = disturbed[1].part(1.0, 4.0)

    moved = replace(later, y=later.y + 50.0)

    np.testing.assert_allclose(predict(fit, moved), predict(fit, later) + 50.0, atol=1e-6)
    assert np.std(later.y - predict(fit, later)) < 1.2 * np.std(residuals(fit)[0])


def test_data_behind_a_chain_are_not_predicted_with_a_noise_model_of_the_bare_shaft(
    disturbed: tuple[Dataset, Dataset],
) -> None:
    fit = PredictionError().fit(STRUCTURES["first_order_one_way"], [disturbed[0]])

    with pytest.raises(UsageError, match="measured through a chain"):
        predict(fit, dataset(seed=1, samples=500, chain="derivative | lowpass 50 rad/s"))


def test_samples_that_look_back_before_the_record_have_no_prediction() -> None:
    data = dataset(seed=1, samples=2000, chain="average 0.01 s")
    declared = replace(data, declared=data.applied, applied=type(data.applied)())
    fit = OutputError().fit(STRUCTURES["first_order_one_way"], [declared])

    (left,) = residuals(fit)

    np.testing.assert_array_equal(np.isnan(left), ~declared.valid)
    assert 0 < np.isnan(left).sum() < 10


def test_the_model_of_the_reference_motor_simulates_it_to_a_count() -> None:
    # Fitted on one record, held against the marched angle of a run it has never seen, which starts at rest as `simulate` does.
    from tests.rig.motor.reference import march

    result = identify(dataset(seed=1))
    t = np.arange(1000) * 0.002
    u = np.where(t < 1.0, 2.5, 1.5)
    angle = march(Truth(), u, 0.002)[:, 2]

    assert np.abs(simulate(result, u, t, output="position") - angle).max() < QUANTUM
    assert validate_with(result.fit, [dataset(seed=9)]).fit_percent > 99.9  # type: ignore[arg-type]


def test_nothing_to_simulate_is_said() -> None:
    from servobench.core.errors import UsageError
    from servobench.identification.identify import identify
    from tests.datasets import dataset

    with pytest.raises(UsageError, match="no samples"):
        simulate(identify(dataset(seed=1, samples=1000)), np.empty(0), np.empty(0))
