"""Every public function of data says in a sentence what is wrong with what it was given, and no foreign error passes."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
import pandas
import pytest

import servobench as sb
from servobench.core.errors import ServobenchError

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
"""What a function needs beside its first argument."""

NO_MISTAKE = {"design": ("None",), "inspect": ("a frame without the column",)}
"""Without data a design is for the data sheet, and any table can be looked at."""

FUNCTIONS = [name for name in sb.__all__ if inspect.isfunction(getattr(sb, name))]


def test_there_are_public_functions() -> None:
    assert {"identify", "inspect", "why", "design", "honest", "compare", "measure", "load"} <= set(FUNCTIONS)


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_wrong_first_argument_is_told_in_a_sentence(
    name: str, wrong: str, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    if wrong in NO_MISTAKE.get(name, ()):
        return
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ServobenchError) as caught:
        getattr(sb, name)(WRONG[wrong], **MORE.get(name, {}))
    assert len(str(caught.value)) > 20
