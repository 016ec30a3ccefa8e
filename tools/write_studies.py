"""Write docs/reference/studies.md from the studies' own settings; a test holds the page equal to this."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

from servobench.cli.catalogue import default_text, meaning
from servobench.core.settings import Settings
from servobench.lab.studies.base import STUDIES

PAGE = Path(__file__).resolve().parent.parent / "docs" / "reference" / "studies.md"

HEAD = """# The studies of exercises

<!-- Written by tools/write_studies.py from the studies' own settings: change those, run `make generate`. -->

What an exercise computes and shows beside its text: `[studies.NAME]` in its front matter, with `type` and the settings
below ([how to write an exercise](../how-to/exercise.md)). A number without a unit is in the unit that stands beside it, and a
text may have another unit of the same quantity. Each study has the setting `paper` as well: the paper's numbers by the
names of columns, a list with one for each row, `""` where it gives none. `servobench lab do NAME --json` tells what the
columns of a study are called.
"""


def page() -> str:
    """Return the page."""
    return "\n".join([HEAD.rstrip(), *(line for name in STUDIES.names() for line in _section(name))]) + "\n"


def _section(name: str) -> list[str]:
    study: Any = STUDIES[name]
    return ["", f"## {name}", "", STUDIES.sentence(name), *_table(study, leave_out=("paper",))]


def _table(settings: type[Settings], leave_out: tuple[str, ...] = ()) -> list[str]:
    """The settings of a model, and those of the tables that it holds arrays of."""
    fields = [(key, field) for key, field in settings.model_fields.items() if key not in leave_out]
    if not fields:
        return []
    lines = ["", "| setting | default | meaning |", "| --- | --- | --- |"]
    lines += [
        f"| `{key}` | {_cell(default_text(field))} | {_cell(meaning(field))} |" for key, field in fields
    ]
    for key, field in fields:
        for inner in _models(field.annotation):
            lines += ["", f"Each of `{key}` is a table of its own:", *_table(inner)]
    return lines


def _models(annotation: Any) -> Iterator[type[Settings]]:
    if isinstance(annotation, type) and issubclass(annotation, Settings):
        yield annotation
    for part in get_args(annotation):
        yield from _models(part)


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "\\|").split())


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8", newline="\n")
