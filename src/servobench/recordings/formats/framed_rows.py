"""Rows in brackets, between bars or with a semicolon behind them, as programs print lists and Markdown and MATLAB write tables:
`(0.01, 3, 12)`, `| 0.01 | 3 | 12 |`, `0.01, 3, 12;`, `0.01 3 12,`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

_FRAMES = (
    re.compile(r"\s*[\[({]++(?P<row>[^\[\](){}]++)[\])}]++\s*+[,;]?+\s*"),
    re.compile(r"\s*\|(?P<row>.*)\|\s*"),
    # Two cells at least; `1,5;` is a number with a decimal comma.
    re.compile(
        r"(?!\s*+[+-]?\d++,\d++\s*+;)(?:\s*+[A-Za-z]\w*+\s*+=\s*+\[)?"
        r"(?P<row>\s*+[^;,\s\[\]]++[,\s]++[^;,\s\[\]][^;\[\]]*+)\]?;\s*+"
    ),
    # A comma behind cells that blanks separate, and what begins and ends the matrix.
    re.compile(
        r"(?:\s*+[A-Za-z]\w*+\s*+=\s*+\[)?(?P<row>\s*+[^,;\s\[\]]++(?:[ \t]++[^,;\s\[\]]++)++)\s*+(?:,|\]?;|\])\s*+"
    ),
)
_SHARE = 0.5  # of the rows, more than which have a frame; the names of the columns may stand without
_RULE = frozenset("-_=|+: \t")
_TITLE = re.compile(r"\s*+[A-Za-z]\w*+\s*+=\s*+\[?+\s*+")  # above a matrix of MATLAB's, or of a script
_ENDS = ("]", "];")  # of such a matrix
_STROKES = ("---", "___", "===", ":-", "-:")
_NEAR = 3  # lines, of which the one above a rule may be blank
_BEGINS_WITH_A_NUMBER = re.compile(r"[\s|\[({]*[+-]?[.0-9]")


def without_frames(content: Sequence[str], sample: Sequence[str]) -> list[str]:
    """Return the rows of a table without what frames them; as they are where not most of a `sample` are framed."""
    for frame in _FRAMES:
        if sum(bool(frame.fullmatch(line)) for line in sample) > _SHARE * len(sample):
            return [match["row"] if (match := frame.fullmatch(line)) else line for line in content]
    return list(content)


def rules(lines: Sequence[str]) -> set[int]:
    """Return which lines, counted from 0, only underline the names above them or name a matrix: `____  ____`, `data =`.

    The lines have no blanks around them. Below a row of numbers, `---` may stand for a missing number.
    """
    return {
        k
        for k, line in enumerate(lines)
        if line in _ENDS
        or (line[:1] in _RULE and _is_rule(lines, k))
        or (line[-1:] in ("=", "[") and _TITLE.fullmatch(line))
    }


def _is_rule(lines: Sequence[str], k: int) -> bool:
    """Whether line k is drawn of strokes, and what stands above it is no row of numbers."""
    if not _RULE.issuperset(lines[k]) or not any(stroke in lines[k] for stroke in _STROKES):
        return False
    above = next((line for line in reversed(lines[max(k - _NEAR, 0) : k]) if line), "")
    return not _BEGINS_WITH_A_NUMBER.match(above)
