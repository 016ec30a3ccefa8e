"""Every doubt and every cause has an example that raises it, and one like it that must not."""

from __future__ import annotations

import importlib
import pkgutil

import pytest

from servobench.core.finding_codes import FINDING_CODES, Role
from servobench.identification.trust.doubts.base import DOUBTS
from tests.contracts import finding_examples
from tests.contracts.finding_examples.base import Example

EXAMPLES: tuple[Example, ...] = tuple(
    example
    for module in pkgutil.iter_modules(finding_examples.__path__)
    for example in getattr(
        importlib.import_module(f"{finding_examples.__name__}.{module.name}"), "EXAMPLES", ()
    )
)
CODES = {each.code for each in FINDING_CODES.values() if each.role is not Role.NOTE} | {
    code for doubt in DOUBTS for code in doubt.codes
}


def test_every_symptom_cause_explanation_and_doubt_has_an_example() -> None:
    without = CODES - {example.code for example in EXAMPLES}

    assert not without, (
        f"add an Example to about_data, about_fits or explanations in {finding_examples.__name__}: {without}"
    )


def test_a_code_has_one_example() -> None:
    codes = [example.code for example in EXAMPLES]

    assert sorted(set(codes)) == sorted(codes)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda each: each.code)
def test_a_finding_is_raised_where_its_fault_is(example: Example) -> None:
    assert example.code in {finding.code for finding in example.raised()}


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda each: each.code)
def test_a_finding_is_absent_where_its_fault_is_not(example: Example) -> None:
    assert example.code not in {finding.code for finding in example.absent()}
