"""Java: a class of constants for a robot's code."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from servobench.export.base import TARGETS, Wishes
from servobench.export.robot import WISHES, robot_constants
from servobench.export.robot_text import (
    check_name,
    constant_lines,
    feedback_text,
    feedforward_arguments,
    header_lines,
)
from servobench.export.summary import ResultSummary

_TEXT = """\
{header}
public final class {stem} {{
{constants}

    // {feedback}
    // {mechanism}Feedforward feedforward = new {mechanism}Feedforward({arguments});

    private {stem}() {{}}
}}
"""


@TARGETS.member("java")
class Java:
    """A class with kS, kV, kA and feedback gains as constants, each with its interval in a comment, to copy into robot code."""

    suffix: ClassVar[str] = ".java"
    wishes: ClassVar[frozenset[str]] = WISHES

    def render(self, answer: ResultSummary, wishes: Wishes, stem: str) -> Mapping[str, bytes]:
        """Return the one file, whose name is the class's; raises `UsageError` as `robot_constants`, or for the name."""
        check_name(stem, "Java")
        constants = robot_constants(answer, "java", wishes)
        text = _TEXT.format(
            header="\n".join(f"// {line}" for line in header_lines(constants)),
            stem=stem,
            constants="\n".join(
                constant_lines(
                    constants,
                    lambda name, number, comment: (
                        f"    public static final double {name} = {number}; // {comment}"
                    ),
                )
            ),
            feedback=feedback_text(constants),
            mechanism=constants.mechanism,
            arguments=feedforward_arguments(constants),
        )
        return {f"{stem}.java": text.encode()}
