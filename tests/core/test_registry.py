"""A kind finds its members by itself, and says which there are."""

import sys
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import pytest

from servobench.core.errors import UnknownName, UsageError
from servobench.core.registry import Registry

BASE = """
from servobench.core.registry import Registry
FRUITS = Registry("fruit", "fruits")
"""
MEMBER = """
from fruits.base import FRUITS
@FRUITS.member("{name}")
class {name}: pass
"""


@pytest.fixture
def fruits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of a kind with two members, importable as `fruits`."""
    folder = tmp_path / "fruits"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "base.py").write_text(BASE)
    for name in ("pear", "apple"):
        (folder / f"{name}.py").write_text(MEMBER.format(name=name))
    monkeypatch.syspath_prepend(tmp_path)
    for module in [name for name in sys.modules if name.split(".")[0] == "fruits"]:
        monkeypatch.delitem(sys.modules, module)
    yield folder
    for module in [name for name in sys.modules if name.split(".")[0] == "fruits"]:
        del sys.modules[module]


def kind() -> Registry[type]:
    from fruits.base import FRUITS  # type: ignore[import-not-found]

    return FRUITS


def plug_in(monkeypatch: pytest.MonkeyPatch, name: str, value: str) -> None:
    entry = EntryPoint(name=name, value=value, group="fruits")
    monkeypatch.setattr("servobench.core.registry._plug_ins", lambda: EntryPoints((entry,)))


def test_a_file_in_the_folder_is_a_member_without_a_line_elsewhere(fruits: Path) -> None:
    (fruits / "plum.py").write_text(MEMBER.format(name="plum"))

    assert kind().names() == ("apple", "pear", "plum")
    assert [member.__name__ for member in kind()] == ["apple", "pear", "plum"]


def test_a_member_is_imported_when_it_is_first_asked_for_all_with_their_names_and_kernels_not_even_then(
    fruits: Path,
) -> None:
    (fruits / "kernels.py").write_text("raise RuntimeError('imported')")
    registry = kind()

    assert "fruits.apple" not in sys.modules
    assert registry["apple"].__name__ == "apple"
    assert "fruits.pear" not in sys.modules
    assert registry.names() == ("apple", "pear")
    with pytest.raises(UnknownName):
        registry["kernels"]


@pytest.mark.parametrize("name", ["base", "fruits.pear", "../pear", "", "péar"])
def test_a_file_of_the_folder_that_is_no_member_and_what_is_no_name_are_unknown(
    fruits: Path, name: str
) -> None:
    with pytest.raises(UnknownName):
        kind()[name]


def test_an_unknown_name_is_reported_with_the_nearest_and_all_known_ones(fruits: Path) -> None:
    with pytest.raises(UnknownName) as caught:
        kind()["aple"]
    assert str(caught.value) == "no fruit called 'aple' (did you mean 'apple'?); known: apple, pear"


def test_a_member_and_a_value_of_it_know_their_name_and_others_have_none(fruits: Path) -> None:
    registry = kind()
    apple = registry["apple"]

    assert registry.name_of(apple) == registry.name_of(apple()) == "apple"
    with pytest.raises(UsageError, match="3 isn't a known fruit; known: apple, pear"):
        registry.name_of(3)


def test_two_members_of_one_name_are_refused_and_one_member_twice_is_not(fruits: Path) -> None:
    registry = kind()
    registry.member("apple")(registry["apple"])

    with pytest.raises(UsageError, match="two members of fruits are called 'apple'"):
        registry.member("apple")(registry["pear"])


def test_after_a_member_that_can_not_be_imported_the_others_are_not_taken_for_all(fruits: Path) -> None:
    (fruits / "apricot.py").write_text("raise ImportError('no stone')")
    registry = kind()

    for _ in range(2):
        with pytest.raises(ImportError, match="no stone"):
            registry.names()


def test_a_plug_in_is_a_member(fruits: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plug_in(monkeypatch, "plum", "pathlib:Path")

    assert kind()["plum"] is Path


def test_a_broken_plug_in_is_named(fruits: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plug_in(monkeypatch, "plum", "pathlib:Plum")

    with pytest.raises(
        UsageError, match=r"the fruit 'plum' can't be loaded: AttributeError.*; update or uninstall"
    ):
        kind().names()


def test_a_plug_in_can_not_take_the_name_of_another_member(
    fruits: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plug_in(monkeypatch, "pear", "pathlib:Path")

    with pytest.raises(UsageError, match="two members of fruits are called 'pear'"):
        kind().names()


def test_a_family_makes_members_from_their_names() -> None:
    structures = Registry[tuple[int, int]]("structure", "servobench.systems.signals", "servobench.signals")

    def grid(name: str) -> tuple[int, int] | None:
        first, _, second = name.partition("x")
        return (int(first), int(second)) if first.isdigit() and second.isdigit() else None

    structures.family("NxM", grid, "N rows and M columns")
    assert structures["3x4"] == (3, 4)
    assert structures["3x4"] is structures["3x4"]
    assert structures.name_of(structures["3x4"]) == "3x4"
    with pytest.raises(UnknownName, match="NxM: N rows and M columns"):
        structures["3by4"]


def test_a_name_where_there_is_none_at_all_lists_nothing() -> None:
    assert str(UnknownName("column", "part", [])) == "no column called 'part'; there are none"
