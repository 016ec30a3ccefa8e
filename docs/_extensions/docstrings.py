"""Docstrings as they are written here, prose with `names` and indented formulas, made readable to Sphinx; settings as lists."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from functools import reduce
from typing import Annotated, Any, get_origin

from docutils import nodes
from pydantic import BaseModel
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.util import inspect

from servobench.cli.catalogue import default_text, meaning
from servobench.core.settings import unit_of

SPAN = re.compile(r"`[^`]+`")
MARKUP = re.compile(r"([*|\\_])")


def escaped(line: str) -> str:
    """Return a line of prose in which stars, bars and underscores mean themselves; what stands between backticks is code."""
    out, at = "", 0
    for span in SPAN.finditer(line):
        out += MARKUP.sub(r"\\\1", line[at : span.start()])
        # A word may follow at once, as in `name`s, which needs an empty separator.
        before = "\\ " if out[-1:].isalnum() else ""
        after = "\\ " if line[span.end() : span.end() + 1].isalnum() else ""
        out += f"{before}`{span[0]}`{after}"
        at = span.end()
    return out + MARKUP.sub(r"\\\1", line[at:])


def as_restructured_text(lines: list[str]) -> list[str]:
    """Return the lines of a docstring with its indented blocks, formulas and drawings, as literal blocks; examples stay."""
    out: list[str] = []
    literal = listed = example = False
    for line in (line.removesuffix("::") + ":" if line.endswith("::") else line for line in lines):
        indented = line.startswith("    ")
        if line.strip() and not indented:
            literal, listed = False, bool(re.match(r"(-|\d+\.) ", line))
        elif indented and not literal and not listed and not (out and out[-1].strip()):
            out += ["::", ""]
            literal = True
        if line.startswith(">>> "):
            example = True
        elif not line.strip():
            example = False
        out.append(line if literal or example else escaped(line))
    return out


def settings_of(model: type[BaseModel]) -> Iterator[str]:
    """Yield the settings of a model as a field list: each with its meaning, unit and default, as the commands tell them."""
    for name, field in model.model_fields.items():
        sentence = meaning(field)
        default, unit = default_text(field), unit_of(field)
        told = [f"in {unit}"] if unit and not default.endswith((unit, f"[{unit}]")) else []
        if field.is_required():
            told.append("has to be given")
        elif isinstance(field.default, BaseModel):
            told.append(f"default `{type(field.default).__name__}()`")
        elif default:
            told.append(f"default {default}")
        yield escaped(
            f":param {name}: {sentence.rstrip('.')} ({'; '.join(told)})."
            if told
            else f":param {name}: {sentence}"
        )


def process(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Rewrite the lines of one docstring in place, as autodoc asks for."""
    lines[:] = as_restructured_text(lines)
    if _is_settings(obj):
        lines += ["", *settings_of(obj), ""]


def signature(
    app: Sphinx, what: str, name: str, obj: object, options: object, given: str | None, back: str | None
) -> Any:
    """Return the signature of settings without its annotations, which stand in the list of the settings; None keeps another."""
    if getattr(obj, "_is_protocol", False) and what == "class":
        return "", None  # nobody makes one
    if not _is_settings(obj):
        return None
    return f"({', '.join(['*', *obj.model_fields]) if obj.model_fields else ''})", None


def skip(app: Sphinx, what: str, name: str, obj: object, would: bool, options: object) -> bool | None:
    """Leave out what pydantic puts into a class, and types of settings, which the list of the settings tells by their units."""
    if get_origin(obj) is Annotated:
        return True
    return True if name.startswith("model_") else None


def leave_out_settings(app: Sphinx, doctree: nodes.document) -> None:
    """Take out the attributes that stand in the list of the settings; what leads to one of them leads to the list."""
    for found in list(doctree.findall(addnodes.desc)):
        name = found[0]
        if found["objtype"] != "attribute" or not name.get("class"):
            continue
        owner = reduce(getattr, name["class"].split("."), sys.modules[name["module"]])
        if _is_settings(owner):
            found.parent["ids"] += name["ids"]
            found.parent.remove(found)


def _is_settings(found: object) -> bool:
    return isinstance(found, type) and issubclass(found, BaseModel)


def setup(app: Sphinx) -> dict[str, Any]:
    """Join autodoc."""
    # Within another type, as in tuple[Array, ...], Sphinx writes an alias with the name of its own class around it.
    inspect.TypeAliasForwardRef.__repr__ = lambda alias: alias.name  # type: ignore[method-assign]
    app.connect("autodoc-process-docstring", process)
    app.connect("autodoc-process-signature", signature)
    app.connect("autodoc-skip-member", skip)
    app.connect(
        "doctree-read", leave_out_settings, priority=400
    )  # before the tables of contents are gathered, at 500
    return {"parallel_read_safe": True, "parallel_write_safe": True}
