"""The exercises that come along: their answers held against algebra, and their texts."""

import math

import pytest
from scipy.optimize import brentq

from servobench.lab.check import check, right_answer
from servobench.lab.exercise import Exercise
from servobench.lab.exercise_file import exercise, exercises
from servobench.lab.expression import Expression
from servobench.lab.markdown import to_html
from servobench.lab.stand import stand_of, stand_on_the_twin

# The simulated motor, as its documentation states it.
R, L, K, J, B, COULOMB = 8.4, 1.16e-3, 0.042, 2.0952e-5, 1e-6, 8e-4
TAU = -1 / max(
    (-(R * J + L * B) + s * math.sqrt((R * J + L * B) ** 2 - 4 * L * J * (R * B + K * K))) / (2 * L * J)
    for s in (1, -1)
)
STEADY = (K - R * COULOMB) / (R * B + K * K)  # rad/s at 1 V: k i = b ω + friction, R i + k ω = 1 V


def behind_a_filter(tau: float, cutoff: float) -> float:
    """The time after which 1/((τs + 1)(s/ω + 1)) has covered 1 - 1/e of a step."""
    lag = 1 / cutoff

    def missing(t: float) -> float:
        return (tau * math.exp(-t / tau) - lag * math.exp(-t / lag)) / (tau - lag) - math.exp(-1)

    return float(brentq(missing, 0.2 * tau, 5 * tau))


def value(found: Exercise, name: str) -> float:
    return Expression(found.blank(name).answer).evaluate(stand_on_the_twin(found).facts).value


def test_the_encoders_answers_are_those_of_its_data_sheet() -> None:
    found = exercise("encoder")

    assert {blank.id: value(found, blank.id) for blank in found.blanks} == pytest.approx(
        {
            "counts": 4 * 512,
            "degrees": 0.17578125,
            "gain": 0.0030679615757712823,
            "angle": 5 * math.pi,  # two turns and a half
            "restart": 0,
            "wrap": 8192,
        },
        rel=1e-12,
    )


def test_a_step_is_read_as_algebra_says() -> None:
    found = exercise("step")

    # The mean speed of the steady part comes from counts over 0.2 s at least: 0.003 rad of 4 rad.
    assert value(found, "gain") == pytest.approx(STEADY, rel=1e-3)
    # The reading interpolates between samples; backward differences delay by half a sample, 1 ms, and the electrical time
    # constant of 0.14 ms comes on top; one count in 2 ms of the speed, filtered to a tenth, moves the crossing by 2 ms at most.
    assert value(found, "read") == pytest.approx(behind_a_filter(TAU, 50) + 0.001, abs=0.002)
    # The identified one comes with its interval, which an encoder at 500 Hz keeps below 0.5 %.
    assert value(found, "time_constant") == pytest.approx(TAU, rel=5e-3)
    assert value(found, "pole") == pytest.approx(-1 / TAU, rel=5e-3)
    assert value(found, "lag") == 20
    assert value(found, "level") == pytest.approx(63.2, abs=0.05)


def test_the_papers_trap_is_caught_and_named() -> None:
    found = exercise("step")
    facts = stand_on_the_twin(found).facts

    answers = {"read": "0.122 s", "time_constant": "0.122 s", "pole": "7.69 rad/s"}
    said = check(found, answers, facts)

    assert said["read"].right
    assert not said["time_constant"].right
    assert "still includes the lag of the filter" in said["time_constant"].sentence
    assert not said["pole"].right
    assert "sign" in said["pole"].sentence


def test_a_students_own_recording_is_what_their_answers_are_held_against() -> None:
    found = exercise("step")
    import servobench as sb

    heavier = found.experiment.model_copy(update={"seed": 3})
    with sb.connect("twin", disc_inertia=6e-5) as motor:
        recording = sb.run(heavier, motor)

    own = stand_of(found, recording).facts

    assert own["time_constant"].value > 2 * stand_on_the_twin(found).facts["time_constant"].value
    assert not check(found, {"time_constant": "0.0991"}, own)["time_constant"].right


def test_a_recording_that_tells_nothing_gives_no_verdict_on_an_answer() -> None:
    found = exercise("step")
    import servobench as sb

    with sb.connect("twin") as motor:
        recording = sb.run(sb.Experiment(signal=sb.Constant(value=0.0), duration=2), motor)

    said = check(found, {"time_constant": "0.1", "gain": "20"}, stand_of(found, recording).facts)

    assert all(not each.right and "can't be checked" in each.sentence for each in said.values())


@pytest.mark.parametrize("found", exercises(), ids=lambda e: e.name)
def test_every_right_answer_is_called_right_and_every_known_mistake_is_not(found: Exercise) -> None:
    facts = stand_on_the_twin(found).facts
    for blank in found.blanks:
        right = Expression(blank.answer).evaluate(facts).value
        said = check(found, {blank.id: f"{right!r} {blank.unit}"}, facts)[blank.id]
        assert said.right, (blank.id, said)
        assert right_answer(blank, facts)
        for mistake in blank.mistakes:
            wrong = Expression(mistake.answer).evaluate(facts).value
            told = check(found, {blank.id: f"{wrong!r} {blank.unit}"}, facts)[blank.id]
            assert (told.right, told.sentence) == (False, mistake.sentence), blank.id


@pytest.mark.parametrize("found", exercises(), ids=lambda e: e.name)
def test_no_answer_stands_in_the_text(found: Exercise) -> None:
    """A blank that the text fills is no exercise."""
    for blank in found.blanks:
        number = Expression(blank.answer).evaluate(stand_on_the_twin(found).facts).value
        if number and abs(number) > 100:
            assert f"{number:.0f}" not in found.text, blank.id


@pytest.mark.parametrize("found", exercises(), ids=lambda e: e.name)
def test_its_experiment_has_nothing_to_be_warned_of(found: Exercise) -> None:
    assert not found.experiment.findings()


@pytest.mark.parametrize(
    "text",
    [
        "<script>alert(1)</script>",
        "a <img src=x onerror=alert(1)> b",
        "[x](javascript:alert(1))",
        "[x](JaVaScRiPt:alert(1))",
        "[x](data:text/html;base64,PHNjcmlwdD4=)",
        "[x](vbscript:x)",
        "![x](http://elsewhere.example/x.png)",
        "<http://x.example/'onmouseover='alert(1)>",
        '[x](http://x.example/"onclick="alert(1))',
        "<svg><style>*{}</style></svg>",
        "<!-- x --> <?php ?> <![CDATA[x]]>",
        "[x]: javascript:alert(1)\n\n[x]",
        "|a|b|\n|-:|:-:|\n|1|<b>2</b>|",
    ],
)
def test_markdown_becomes_nothing_but_plain_tags(text: str) -> None:
    """Read with Python's own parser: no tag but those of text, no attribute but those of a link, no address that runs."""
    from html.parser import HTMLParser

    seen: list[tuple[str, dict[str, str | None]]] = []

    class Reader(HTMLParser):
        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            seen.append((tag, dict(attrs)))

    Reader().feed(to_html(text))

    allowed = {
        "p",
        "a",
        "table",
        "thead",
        "tbody",
        "tr",
        "th",
        "td",
        "em",
        "strong",
        "ul",
        "ol",
        "li",
        "code",
    }
    assert {tag for tag, _ in seen} <= allowed
    for tag, attributes in seen:
        assert set(attributes) <= ({"href", "rel"} if tag == "a" else set())
        assert (attributes.get("href") or "http:").startswith(("http:", "https:", "mailto:"))


@pytest.mark.parametrize(
    ("name", "blank", "answer", "said"),
    [
        ("step", "pole", "-7.69", "the paper's 0.13 s"),
        ("step", "read", "0.13", "the paper's figure"),
        ("step", "time_constant", "0.13", "the paper's figure"),
        ("step", "gain", "23.7", "1/k of the data sheet"),
        ("stability", "pole", "-7.69", "the paper's pole"),
        ("encoder", "wrap", "32", "right for a counter of 16 bits"),  # 2^16/2048; the twin's has 24
        ("encoder", "wrap", "2097152", "right for a counter of 32 bits"),
    ],
)
def test_figures_of_the_paper_and_of_other_counters_are_known_mistakes(
    name: str, blank: str, answer: str, said: str
) -> None:
    found = exercise(name)

    checked = check(found, {blank: answer}, stand_on_the_twin(found).facts)[blank]

    assert not checked.right
    assert said in checked.sentence
