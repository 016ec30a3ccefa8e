"""The whole result as JSON: for any program."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import ClassVar

from servobench.export.base import TARGETS, Wishes
from servobench.export.summary import ResultSummary


@TARGETS.member("json")
class Json:
    """The result, all of it, in the schema `servobench.result/2`, which is part of the package."""

    suffix: ClassVar[str] = ".json"
    wishes: ClassVar[frozenset[str]] = frozenset()

    def render(self, answer: ResultSummary, wishes: Wishes, stem: str) -> Mapping[str, bytes]:
        """Return the one file."""
        text = json.dumps(answer.document, indent=2, ensure_ascii=False, allow_nan=False)
        return {f"{stem}.json": f"{text}\n".encode()}
