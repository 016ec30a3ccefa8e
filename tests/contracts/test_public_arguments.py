"""Every public function of data says in a sentence what is wrong with what it was given, and no foreign error passes."""

from __future__ import annotations

import inspect
from contextlib import suppress
from functools import cache
from typing import Any, get_type_hints

import numpy as np
import pandas
import pytest

import servobench as sb
from servobench.core.errors import ServobenchError, UsageError
from servobench.recordings.reading import ReadingOptions
from tests.datasets import dataset

WRONG: dict[str, Any] = {
    "None": None,
    "an empty list": [],
    "a list of numbers": [1.0, 2.0],
    "a text": "there-is-no-such-file.csv",
    "a number": 3.5,
    "an array": np.zeros((4, 2)),
    "a frame without the column": pandas.DataFrame({"a": [1.0, 2.0], "b": [0.0, 1.0]}),
    "a frame of texts": pandas.DataFrame({"a": ["x", "y"]}),
    "a function": len,
}

MORE: dict[str, dict[str, Any]] = {
    "ensemble": {"experiment": sb.Experiment(duration=0.1), "n": 2, "spread": {}},
    "from_control": {"output": "speed", "unit": "rad/(s·V)"},
    "from_scipy": {"output": "speed", "unit": "rad/(s·V)"},
    "predict": {"data": None},
    "reconcile": {"parameters": None},
    "design": {"limits": {"voltage": 5.0}},
    "run": {"device": None},
    "save": {"path": "nowhere.csv"},
    "simulate": {"drive": np.zeros(4), "t": np.arange(4.0)},
    "why": {"claims": ["tau=0.13"]},
}
"""The other arguments that a function needs."""

NO_MISTAKE = {"design": ("None",), "inspect": ("a frame without the column",)}
"""Without data a design is for the data sheet, and any table can be looked at."""

DATA_FUNCTIONS = (
    *("bibo", "compare", "connect", "design", "ensemble", "from_control", "from_scipy", "honest", "identify"),
    *("predict", "residuals", "simulate", "stability", "to_control", "to_scipy", "validate", "why"),
)
"""Those of `right_arguments`, which identifies a motor: nothing for each worker to do while tests are collected."""

FUNCTIONS = [name for name in sb.__all__ if inspect.isfunction(getattr(sb, name))]


def test_there_are_public_functions() -> None:
    assert sorted(DATA_FUNCTIONS) == sorted(right_arguments())
    assert {"identify", "inspect", "why", "design", "honest", "compare", "measure", "load"} <= set(FUNCTIONS)


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_wrong_first_argument_is_reported_in_a_sentence(
    name: str, wrong: str, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    if wrong in NO_MISTAKE.get(name, ()):
        return
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ServobenchError) as caught:
        getattr(sb, name)(WRONG[wrong], **MORE.get(name, {}))
    assert len(str(caught.value)) > 20


@cache
def result() -> sb.Result:
    return sb.identify([dataset(seed=1, kind="prbs", samples=400)])


def right_arguments() -> dict[str, dict[str, Any]]:
    """A call of each function that is right, so that one argument after the other can be wrong."""
    data, system = dataset(seed=1, kind="prbs", samples=400), result().transfer_function
    return {
        "bibo": {"data": data},
        "compare": {"models": result(), "data": data},
        "connect": {"name": "twin"},
        "design": {
            "data": result(),
            "limits": {"voltage": 5.0},
            "duration": 0.5,
            "experiment_sample_time": 0.01,
        },
        "ensemble": {
            "motor": "qube_servo_2",
            "experiment": sb.Experiment(duration=0.1),
            "n": 2,
            "spread": {"resistance": "5%"},
        },
        "from_control": {"system": sb.to_control(system), "output": "speed", "unit": "rad/(s·V)"},
        "from_scipy": {"system": sb.to_scipy(system), "output": "speed", "unit": "rad/(s·V)"},
        "honest": {"data": [data, dataset(seed=2, kind="prbs", samples=400)]},
        "identify": {"data": data},
        "predict": {"fit": result(), "data": data},
        "residuals": {"fit": result()},
        "simulate": {"model": result(), "drive": data.u, "t": data.t_input},
        "stability": {"system": system},
        "to_control": {"system": system},
        "to_scipy": {"system": system},
        "validate": {"fit": result().fit},
        "why": {"data": result(), "claims": ["tau=0.13"]},
    }


def arguments(name: str) -> list[str]:
    """The names of a function's arguments, those of how to read data with them."""
    found = inspect.signature(getattr(sb, name)).parameters.values()
    reads = any(each.kind is each.VAR_KEYWORD for each in found) and name != "connect"
    own = [each.name for each in found if each.kind not in (each.VAR_KEYWORD, each.VAR_POSITIONAL)]
    return [*own, *(get_type_hints(ReadingOptions) if reads else ())]


@pytest.mark.parametrize("name", DATA_FUNCTIONS)
def test_the_right_arguments_are_right(name: str) -> None:
    getattr(sb, name)(**right_arguments()[name])


@pytest.mark.parametrize(
    ("name", "argument"), [(name, each) for name in DATA_FUNCTIONS for each in arguments(name)]
)
def test_no_wrong_argument_passes_a_foreign_error(name: str, argument: str) -> None:
    """A value that happens to be right may pass, such as None where it is the default; a wrong one gets a sentence."""
    right, wrong = right_arguments()[name], [*WRONG.values(), -1, float("nan"), {1: 2}, True]
    for each in wrong:
        with suppress(ServobenchError):
            getattr(sb, name)(**{**right, argument: each})


@pytest.mark.parametrize("name", [name for name in sb.__all__ if inspect.isclass(getattr(sb, name))])
def test_what_is_made_of_wrong_settings_is_reported_in_a_sentence(name: str) -> None:
    made = getattr(sb, name)
    for argument in inspect.signature(made).parameters:
        with pytest.raises((UsageError, TypeError)) as caught:
            made(**{argument: object()})
        # Python itself says which argument is missing.
        assert isinstance(caught.value, UsageError) or "missing" in str(caught.value)


def test_settings_are_named() -> None:
    with pytest.raises(UsageError, match=r"Step\(initial=..., final=..., start=...\)"):
        sb.Step(3.0)  # type: ignore[call-arg]
    with pytest.raises(UsageError, match="did you mean 'final'"):
        sb.Step(finl=3.0)  # type: ignore[call-arg]
