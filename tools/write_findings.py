"""Write docs/reference/findings.md from the table of finding codes.

A test holds the page equal to this. Run `make generate` after a change of `servobench.core.finding_codes`.
"""

import sys
from pathlib import Path

from servobench.core.finding_codes import FINDING_CODES, FindingCode, Role

PAGE = Path(__file__).resolve().parent.parent / "docs" / "reference" / "findings.md"

HEAD = """# Findings

<!-- Written by tools/write_findings.py from `servobench.core.finding_codes`: change that, run `make generate`. -->

Each finding has a code, in `result.json`, in the report and behind `--json`. A code keeps its meaning; its sentence may change.
How much a finding weighs (`info`, `warning`, `refusal`, `danger`) stands with the finding, as it may depend on the data.

| role | what it means for a bad fit |
| --- | --- |
| symptom | something is wrong: servobench looks for a cause |
| cause | the record has this fault: no further cause is looked for |
| explanation | a fit with this cause explains what the plain one doesn't |

| code | meaning | what to do | role |
| --- | --- | --- | --- |
"""


def row(each: FindingCode) -> str:
    """Return a code as a row of the table."""
    role = "" if each.role is Role.NOTE else each.role.value
    return f"| `{each.code}` | {each.meaning} | {each.remedy} | {role} |\n"


def page() -> str:
    """Return the page."""
    return HEAD + "".join(map(row, FINDING_CODES.values()))


def write(file: Path = PAGE) -> None:
    """Write the page."""
    file.write_text(page(), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    write()
    sys.exit()
