"""Expressions of rules: arithmetic, nothing else, and how far it is known."""

import math

import pytest

from servobench.core.errors import UnknownName, UsageError
from servobench.lab.expression import Expression, Fact

FACTS = {"a": Fact(value=3.0), "b": Fact(value=-2.0, half=0.1), "open": Fact(value=1.0, half=math.inf)}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2 * pi / a", 2 * math.pi / 3),
        ("-(a + b) ** 2", -1.0),
        ("100 * (1 - exp(-1))", 63.212055882855765),
        ("sqrt(a ** 2 + 16)", 5.0),
        ("log(exp(a)) - abs(b)", 1.0),
        ("1e3 * a", 3000.0),
    ],
)
def test_it_computes(text: str, value: float) -> None:
    assert Expression(text).evaluate(FACTS).value == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "a +",
        "__import__('os')",
        "a.real",
        "a[0]",
        "'text'",
        "True",
        "a < b",
        "a if b else a",
        "exp(a, b)",
        "sqrt(x=1)",
        "lambda: 1",
        "[a for a in b]",
        "print(1)",
        "(a := 1)",
        "f'{a}'",
        "a % b",
        "9" * 5000,
        "(" * 190,
        "a\x00b",
    ],
)
def test_anything_else_is_refused_when_it_is_read(text: str) -> None:
    with pytest.raises(UsageError):
        Expression(text)


@pytest.mark.parametrize(
    "text", ["1 / (a - 3)", "log(b)", "(b) ** 0.5", "a ** 9999", "exp(1000)", "9.0 ** 60 ** 9"]
)
def test_what_has_no_value_is_reported_and_costs_nothing(text: str) -> None:
    with pytest.raises(UsageError, match="value"):
        Expression(text).evaluate(FACTS)


def test_a_fact_that_is_not_there_is_named_with_those_that_are() -> None:
    with pytest.raises(UnknownName, match=r"no fact called 'aa' \(did you mean 'a'\?\); known: a, b"):
        Expression("aa + 1").evaluate(FACTS)


def test_facts_are_named_without_functions_and_constants() -> None:
    assert Expression("sqrt(a) * pi + b / a").names == ("a", "b")


def test_intervals_add_up_by_their_slopes() -> None:
    # |d(a b²)/db| = |2 a b| = 12, times half an interval of 0.1; the slope is a difference with a step of 1e-6 of b.
    assert Expression("a * b ** 2").evaluate(FACTS).half == pytest.approx(1.2, rel=1e-5)
    assert Expression("2 * a").evaluate(FACTS).half == 0


def test_what_is_not_known_has_no_end_and_what_cancels_does_not_matter() -> None:
    assert Expression("2 * open").evaluate(FACTS).half == math.inf
    assert Expression("open - open + a").evaluate(FACTS).half == 0
