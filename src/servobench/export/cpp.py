"""C++: a header of constants for a robot's code."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from servobench.export.base import TARGETS, Wishes
from servobench.export.robot import WISHES, robot_constants
from servobench.export.robot_text import check_name, constant_lines, feedback_text, header_lines
from servobench.export.summary import ResultSummary

_TEXT = """\
{header}
#pragma once

namespace {stem} {{
{constants}
// {feedback}
}} // namespace {stem}
"""


@TARGETS.member("cpp")
class Cpp:
    """A header with kS, kV, kA and feedback gains as constants, each with its interval in a comment, to copy into robot code."""

    suffix: ClassVar[str] = ".h"
    wishes: ClassVar[frozenset[str]] = WISHES

    def render(self, answer: ResultSummary, wishes: Wishes, stem: str) -> Mapping[str, bytes]:
        """Return the one file, whose name is the namespace's; raises `UsageError` as `robot_constants`, or for the name."""
        check_name(stem, "C++")
        constants = robot_constants(answer, "cpp", wishes)
        text = _TEXT.format(
            header="\n".join(f"// {line}" for line in header_lines(constants)),
            stem=stem,
            constants="\n".join(
                constant_lines(
                    constants,
                    lambda name, number, comment: f"constexpr double {name} = {number}; // {comment}",
                )
            ),
            feedback=feedback_text(constants),
        )
        return {f"{stem}.h": text.encode()}
