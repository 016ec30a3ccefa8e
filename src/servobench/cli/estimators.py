"""`servobench estimators`: the methods that fit a model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from servobench.cli.options import AsJson, MemberName


def estimators(name: MemberName = None, as_json: AsJson = False) -> None:
    """List the estimators, and what each one can do.

    With NAME, only that one: `servobench identify FILE --estimator NAME`.
    """
    from dataclasses import asdict

    from servobench.cli.catalogue import Member, list_members
    from servobench.identification.estimators.base import ESTIMATORS

    members = [
        Member(
            name=each, sentence=ESTIMATORS.sentence(each), facts=_facts(asdict(ESTIMATORS[each].abilities))
        )
        for each in ESTIMATORS.names()
    ]
    list_members("estimator", members, name, as_json)


def _facts(abilities: Mapping[str, Any]) -> dict[str, Any]:
    """An estimator's abilities: its texts, and the list of what it can do."""
    from servobench.core.parameter_names import plain_words

    texts = {name: value for name, value in abilities.items() if isinstance(value, str) and value}
    return {**texts, "can": [plain_words(name) for name, value in abilities.items() if value is True]}
