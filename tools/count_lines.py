"""Count the lines of code of a tree: without docstrings, comments and blank lines.

Run: python tools/count_lines.py [FOLDER]; `make check` prints the figure.
"""

from __future__ import annotations

import ast
import io
import sys
import tokenize
from pathlib import Path

_NOT_CODE = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
    tokenize.ENCODING, tokenize.ENDMARKER,
}  # fmt: skip
_HAS_DOCSTRING = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def code_lines(source: str) -> int:
    """Return how many lines hold code: one token at least that isn't a comment or a docstring."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in _NOT_CODE:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, _HAS_DOCSTRING) and ast.get_docstring(node, clean=False) is not None:
            text = node.body[0]
            lines.difference_update(range(text.lineno, (text.end_lineno or text.lineno) + 1))
    return len(lines)


def main(folder: str = "src/servobench") -> None:
    """Print the lines of each room and their sum."""
    rooms: dict[str, int] = {}
    for path in sorted(Path(folder).rglob("*.py")):
        room = path.relative_to(folder).parts[0].removesuffix(".py")
        rooms[room] = rooms.get(room, 0) + code_lines(path.read_text(encoding="utf-8"))
    for room, lines in sorted(rooms.items(), key=lambda item: -item[1]):
        print(f"{lines:7,}  {room}")
    print(f"{sum(rooms.values()):7,}  lines of code in {folder}")


if __name__ == "__main__":
    main(*sys.argv[1:])
