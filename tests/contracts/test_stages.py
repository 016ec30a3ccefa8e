"""Every stage of a measurement chain, including those of plug-ins."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from servobench.core.errors import UsageError
from servobench.recordings.measurement.base import STAGES, Chain, Stage, fold

EXAMPLES = [(name, text) for name in STAGES.names() for text in STAGES[name].examples]
LINEAR = [text for name, text in EXAMPLES if STAGES[name].linear]
CHAINS = [
    *LINEAR,
    "derivative | lowpass 50 rad/s | lowpass 50 rad/s zoh | average 20 ms",
    "tachometer 10 ms | average 7 ms | lowpass 30 rad/s euler",
    "lowpass 20 rad/s | derivative | scale -2",
]

REGULAR = 3.0 + 0.002 * np.arange(700)
IRREGULAR = np.cumsum(np.random.default_rng(2).uniform(0.0004, 0.006, 700))
TIMES = pytest.mark.parametrize("t", [REGULAR, IRREGULAR], ids=["regular", "irregular"])


def stage(text: str) -> Stage:
    return Chain.parse(text).stages[0]


def signal(t: np.ndarray, seed: int = 5) -> np.ndarray:
    return np.cumsum(np.random.default_rng(seed).normal(size=len(t)))


@pytest.mark.parametrize(("name", "text"), EXAMPLES)
def test_a_stage_is_known_by_the_name_that_its_texts_begin_with(name: str, text: str) -> None:
    assert isinstance(stage(text), Stage)
    assert STAGES.name_of(stage(text)) == name == text.split()[0]


@pytest.mark.parametrize(("name", "text"), EXAMPLES)
def test_the_text_of_a_stage_reads_back_as_the_same_stage(name: str, text: str) -> None:
    assert stage(str(stage(text))) == stage(text)
    assert hash(stage(str(stage(text)))) == hash(stage(text))


@pytest.mark.parametrize(("name", "text"), EXAMPLES)
def test_a_stage_cannot_be_changed(name: str, text: str) -> None:
    with pytest.raises((FrozenInstanceError, AttributeError, TypeError)):
        stage(text).anything = 1  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", STAGES.names())
@pytest.mark.parametrize("words", ["nonsense", "1 2 3", "nan Hz", "-1 s", "0 counts", "1e999 s", "5 kg"])
def test_words_that_describe_no_stage_are_refused_with_the_name_of_the_stage(name: str, words: str) -> None:
    with pytest.raises(UsageError, match=name):
        Chain.parse(f"{name} {words}")


@TIMES
@pytest.mark.parametrize(("name", "text"), EXAMPLES)
def test_live_and_whole_record_agree(name: str, text: str, t: np.ndarray) -> None:
    x = signal(t)

    whole, live = stage(text)(x, t), fold(stage(text), x, t)

    # Some hundred operations, each rounded to 1.1e-16 of the largest number in it.
    np.testing.assert_allclose(whole, live, rtol=0, atol=1e-12 * np.abs(live).max())


@TIMES
@pytest.mark.parametrize(("name", "text"), EXAMPLES)
def test_signals_beside_each_other_do_not_touch(name: str, text: str, t: np.ndarray) -> None:
    x = np.stack([signal(t, 1), signal(t, 2), signal(t, 3)], axis=1)

    together = stage(text)(x, t)

    alone = np.stack([stage(text)(column, t) for column in x.T], axis=1)
    np.testing.assert_array_equal(together, alone)


@TIMES
@pytest.mark.parametrize(("name", "text"), EXAMPLES)
def test_what_comes_later_changes_nothing_before(name: str, text: str, t: np.ndarray) -> None:
    x = signal(t)
    other = np.where(np.arange(len(t)) < 300, x, -2.0 * x)

    np.testing.assert_array_equal(stage(text)(x, t)[:300], stage(text)(other, t)[:300])


@pytest.mark.parametrize(("name", "text"), EXAMPLES)
def test_a_step_leaves_the_state_it_was_given_alone(name: str, text: str) -> None:
    one = stage(text)
    state = one.start()
    for x, dt in [(1.0, 0.0), (3.0, 0.002), (-2.0, 0.003)]:
        first = one.step(state, x, dt)
        assert one.step(state, x, dt) == first
        state = first[0]


@pytest.mark.parametrize(("name", "text"), EXAMPLES)
@pytest.mark.parametrize("samples", [0, 1, 2])
def test_a_short_record_keeps_its_length(name: str, text: str, samples: int) -> None:
    t = 0.002 * np.arange(samples)

    assert stage(text)(np.ones(samples), t).shape == (samples,)
    assert stage(text)(np.ones((samples, 3)), t).shape == (samples, 3)
    assert Chain.parse(text).valid(t).shape == (samples,)
    assert len(Chain.parse(text).start_responses(t)) == samples


@TIMES
@pytest.mark.parametrize("text", LINEAR)
def test_a_linear_stage_adds_and_scales(text: str, t: np.ndarray) -> None:
    a, b = signal(t, 1), signal(t, 2)
    one = stage(text)

    combined = 2.0 * one(a, t) - 3.0 * one(b, t)

    np.testing.assert_allclose(
        one(2.0 * a - 3.0 * b, t), combined, rtol=0, atol=1e-12 * np.abs(combined).max()
    )


@TIMES
@pytest.mark.parametrize("text", CHAINS)
def test_a_record_that_begins_in_the_middle_lacks_no_more_than_its_start_states(
    text: str, t: np.ndarray
) -> None:
    """Valid samples of a later part differ from the whole record by the responses to start states, and by nothing else."""
    chain, x, cut = Chain.parse(text), signal(t), 200
    part = slice(cut, None)

    lacking = (chain(x, t)[part] - chain(x[part], t[part]))[chain.valid(t[part])]

    responses = chain.start_responses(t[part])[chain.valid(t[part])]
    explained = (
        responses @ np.linalg.lstsq(responses, lacking)[0] if responses.shape[1] else np.zeros_like(lacking)
    )
    # The least squares of two nearly equal decays have a condition number of some hundred.
    np.testing.assert_allclose(lacking, explained, rtol=0, atol=1e-11 * np.abs(chain(x, t)).max())


@TIMES
@pytest.mark.parametrize("text", CHAINS)
def test_no_more_samples_are_lost_than_the_windows_take(text: str, t: np.ndarray) -> None:
    assert (
        t[np.argmax(Chain.parse(text).valid(t))] - t[0] < 0.103 + 0.0124
    )  # the longest window, and two samples more


@TIMES
@pytest.mark.parametrize("text", LINEAR)
def test_a_decaying_start_state_is_declared_as_one(text: str, t: np.ndarray) -> None:
    response = stage(text).start_response(t)
    states = Chain.parse(text).start_states("position")

    assert len(states) == (response is not None)
    if response is not None:
        assert response[0] == 1.0
        assert np.all(np.diff(np.abs(response)) <= 0)
        assert abs(response[-1]) < 1e-8


@pytest.mark.parametrize(("name", "text"), EXAMPLES)
def test_a_stage_makes_a_position_or_a_speed_of_a_position(name: str, text: str) -> None:
    assert stage(text).yields("position") in {"position", "speed"}


@pytest.mark.parametrize(("name", "text"), EXAMPLES)
def test_a_stage_keeps_a_speed_or_refuses_it_in_a_sentence_with_its_name(name: str, text: str) -> None:
    if Chain.parse(text).takes is None:
        assert stage(text).yields("speed") == "speed"
    else:
        with pytest.raises(UsageError, match=f"`{name}`"):
            stage(text).yields("speed")
