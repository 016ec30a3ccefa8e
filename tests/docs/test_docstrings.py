"""Every public name says what it is; and where one doesn't, the check finds it."""

from __future__ import annotations

import doctest
import importlib
import re
from pathlib import Path

import pytest

import servobench
from tests.docs.pages import ROOT
from tests.test_house import tool

REFERENCE = ROOT / "docs" / "reference" / "python"
SOURCE = ROOT / "src" / "servobench"
WITH_EXAMPLES = sorted(
    ".".join(file.relative_to(SOURCE.parent).with_suffix("").parts).removesuffix(".__init__")
    for file in SOURCE.rglob("*.py")
    if ">>>" in file.read_text(encoding="utf-8")
)

GOOD = '''"""A module."""

from servobench.core.channels import Array
from servobench.core.errors import UsageError


class Thing:
    """A thing of some `size` [m]. Raises `UsageError` for a negative one."""

    size: float
    colour: str
    """What it looks like."""

    def __post_init__(self) -> None:
        if self.size < 0:
            raise UsageError("negative")

    def __call__(self, t: Array) -> Array:
        """Return the size at the times t [s], (N,)."""

    @property
    def half(self) -> float:
        """Half of its size [m]."""


def slowed(voltage: float) -> float:
    """Return a smaller voltage [V]; raises `UsageError` for none."""
    if not voltage:
        raise UsageError("none")


def _hidden(voltage):
    pass
'''


def faults(text: str, folder: Path) -> list[str]:
    package = folder / "package"
    package.mkdir(parents=True)
    (package / "module.py").write_text(text, encoding="utf-8")
    return list(tool("check_docstrings").of_file(package / "module.py", package))


LAW = '"""A lag: |G| = 1/√(1 + ω²τ²){source}."""\n'


def without_source(text: str, folder: Path, name: str = "systems/filters/lag.py") -> list[str]:
    """The check's faults for a module of an otherwise faultless package."""
    file = folder / "package" / name
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")
    return list(tool("check_docstrings").of_file(file, folder / "package"))


BASE = '"""A kind."""\n\n\nclass Member({of}):\n    """One of the kind."""\n\n    colour: str\n    """What it looks like."""\n'
MEMBER = '"""A member."""\n\n\nclass Red:\n    """Something red."""\n\n    colour: str = "red"\n'
SHARED = '"""Some loops{shape}."""\n\n\ndef loop(x: Array) -> None:\n    """Go round."""\n'


def faults_of_last(files: dict[str, str], last: str, package: Path) -> list[str]:
    """The check's faults for the last of these files."""
    for name, text in files.items():
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text(text, encoding="utf-8")
    return list(tool("check_docstrings").of_file(package / last, package))


def test_a_field_that_the_protocol_of_the_kind_describes_is_described_in_each_member(tmp_path: Path) -> None:
    protocol, plain = BASE.format(of="Protocol"), BASE.format(of="")

    for member in ("kind/red.py", "kind/deeper/red.py"):
        assert faults_of_last({"kind/base.py": protocol, member: MEMBER}, member, tmp_path / "a") == []
    assert (
        len(faults_of_last({"kind/base.py": plain, "kind/red.py": MEMBER}, "kind/red.py", tmp_path / "b"))
        == 1
    )
    assert len(faults_of_last({"kind/base.py": protocol, "red.py": MEMBER}, "red.py", tmp_path / "c")) == 1


def test_kernels_may_tell_shapes_once_for_all(tmp_path: Path) -> None:
    told, untold = SHARED.format(shape=" over x (N,)"), SHARED.format(shape="")

    assert faults_of_last({"kernels.py": told}, "kernels.py", tmp_path / "a") == []
    assert len(faults_of_last({"kernels.py": untold}, "kernels.py", tmp_path / "b")) == 1
    assert len(faults_of_last({"loops.py": told}, "loops.py", tmp_path / "c")) == 1


def test_every_public_name_says_what_it_is() -> None:
    assert tool("check_docstrings").problems() == []


def test_a_module_that_says_everything_has_no_fault(tmp_path: Path) -> None:
    assert faults(GOOD, tmp_path) == []


@pytest.mark.parametrize(
    ("said", "unsaid", "fault"),
    [
        ('"""A module."""\n', "", "the module has no docstring"),
        ('        """Half of its size [m]."""', "        pass", "Thing.half has no docstring"),
        ('        """Return the size at the times t [s], (N,)."""', "        pass", "Thing.__call__ has no docstring"),
        ('    """What it looks like."""\n', "", "Thing.colour: nothing says what this field is"),
        (" Raises `UsageError` for a negative one.", "", "Thing raises UsageError"),
        ("; raises `UsageError` for none", "", "slowed raises UsageError"),
        (" t [s], (N,)", " t [s]", "Thing.__call__: no shape is told of t, the result"),
        ("a smaller voltage [V]", "a smaller voltage", "slowed: no unit is told of voltage"),
    ],
)  # fmt: skip
def test_what_is_left_unsaid_is_found(said: str, unsaid: str, fault: str, tmp_path: Path) -> None:
    assert said in GOOD

    found = faults(GOOD.replace(said, unsaid), tmp_path)

    assert len(found) == 1
    assert fault in found[0]


@pytest.mark.parametrize(
    "source",
    [
        " (Van Loan 1978)",
        " (Franklin, Powell and\nEmami-Naeini 2015, chapter 6)",
        " (Schroeder, IEEE Trans. Inf. Theory 16, 1970)",
        " (JCGM 101:2008)",
        ", section II.D of the paper",
        ", which follows from G = 1/(1 + jωτ)",
        " (docs/decisions/0025-filters.md)",
    ],
)
def test_a_law_with_a_source_has_no_fault(source: str, tmp_path: Path) -> None:
    assert without_source(LAW.format(source=source), tmp_path) == []


@pytest.mark.parametrize(
    "source",
    [
        "",
        " for 2000 samples, Counts 2048 and Lines 2000 samples",  # a number is no year
        " (Van Loan)",
        ", as in the paper",
        " (docs/decisions/0025-nothing.md)",  # a page that isn't there
        ' (source: see `filters.nothing`)',
    ],
)  # fmt: skip
def test_a_law_without_a_source_is_found(source: str, tmp_path: Path) -> None:
    (found,) = without_source(LAW.format(source=source), tmp_path)

    assert found.startswith(
        "package/systems/filters/lag.py:1: nothing says where the law or method comes from"
    )


def test_words_of_a_derivation_are_no_source_without_its_formula(tmp_path: Path) -> None:
    assert len(without_source('"""A lag. It follows from algebra, by definition."""\n', tmp_path)) == 1


def test_a_source_may_stand_in_another_module_that_has_one(tmp_path: Path) -> None:
    pointing = LAW.format(source=". Source: see `models.lag`")
    without_source('"""Nothing but words."""\n', tmp_path, "identification/models/lag.py")
    assert len(without_source(pointing, tmp_path)) == 1

    without_source(LAW.format(source=" (Kalman 1960)"), tmp_path, "identification/models/lag.py")
    assert without_source(pointing, tmp_path) == []


def test_a_source_is_asked_for_where_a_law_stands(tmp_path: Path) -> None:
    law, words = LAW.format(source=""), '"""Words without a formula."""\n'

    assert len(without_source(law, tmp_path, "identification/models/lag.py")) == 1
    assert (
        len(without_source(words, tmp_path, "systems/filters/words.py")) == 1
    )  # each file there is a method
    assert without_source(words, tmp_path, "identification/models/words.py") == []
    assert without_source(law, tmp_path, "identification/models/base.py") == []
    assert without_source(law, tmp_path, "panel/lag.py") == []


def test_a_source_in_what_nobody_is_shown_doesn_t_count(tmp_path: Path) -> None:
    hidden = LAW.format(source="") + '\n\ndef _hidden() -> None:\n    """By Kalman 1960."""\n'

    assert len(without_source(hidden, tmp_path)) == 1


def test_the_errors_of_the_package_are_found_with_what_they_are() -> None:
    ours = tool("check_docstrings").errors_of(SOURCE)

    assert ours["UnknownName"] == {"UsageError"}
    assert ours["OutputGone"] == {"StorageError"}
    assert ours["NotIdentifiable"] == ours["RunEnded"] == set()
    assert "Recording" not in ours


def test_an_error_is_named_by_one_that_it_is_but_not_by_another(tmp_path: Path) -> None:
    raising = GOOD.replace('raise UsageError("none")', 'raise UnknownName("size", "x", [])')

    assert faults(raising, tmp_path) == []
    assert (
        len(faults(raising.replace("raises `UsageError` for none", "raises `FormatError`"), tmp_path / "b"))
        == 1
    )


def test_the_reference_shows_all_names_of_the_package() -> None:
    pages = [page.read_text(encoding="utf-8") for page in sorted(REFERENCE.glob("*.md"))]
    shown = {
        name
        for page in pages
        for name in re.findall(r"^\.\. (?:auto\w+|py:data):: ([\w.]+)$", page, re.MULTILINE)
    }

    missing = [name for name in servobench.__all__ if f"servobench.{name}" not in shown]

    assert missing == ["__version__"]


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_the_examples_in_docstrings_run(name: str) -> None:
    result = doctest.testmod(importlib.import_module(name), optionflags=doctest.ELLIPSIS)

    assert result.failed == 0
    assert result.attempted > 0


@pytest.mark.parametrize("name", [name for name in servobench.__all__ if callable(getattr(servobench, name))])
def test_each_public_name_has_an_example(name: str) -> None:
    assert ">>> " in (getattr(servobench, name).__doc__ or "")


def test_there_are_examples_in_docstrings() -> None:
    assert {
        "servobench.core.units",
        "servobench.systems.transfer_function",
        "servobench.recordings.measurement.base",
    } <= set(WITH_EXAMPLES)
