"""Python: a module of constants for a robot's code."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from servobench.export.base import TARGETS, Wishes
from servobench.export.robot import WISHES, robot_constants
from servobench.export.robot_text import check_name, constant_lines, feedback_text, header_lines
from servobench.export.summary import ResultSummary


@TARGETS.member("python")
class Python:
    """A module with kS, kV, kA and feedback gains as constants, each with its interval in a comment, to copy into robot code."""

    suffix: ClassVar[str] = ".py"
    wishes: ClassVar[frozenset[str]] = WISHES

    def render(self, answer: ResultSummary, wishes: Wishes, stem: str) -> Mapping[str, bytes]:
        """Return the one file; raises `UsageError` as `robot_constants`, or for the name."""
        check_name(stem, "Python")
        constants = robot_constants(answer, "python", wishes)
        lines = [
            *(f"# {line}" for line in header_lines(constants)),
            "",
            *constant_lines(constants, lambda name, number, comment: f"{name} = {number}  # {comment}"),
            f"# {feedback_text(constants)}",
        ]
        return {f"{stem}.py": ("\n".join(lines) + "\n").encode()}
