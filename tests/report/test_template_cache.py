from pathlib import Path
from typing import Any

import pytest
from jinja2 import DictLoader, Environment

from servobench.report import template_cache
from servobench.report.template_cache import TemplateCache


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for compiled templates, in place of the package's."""
    monkeypatch.setattr(template_cache, "cache_from_source", lambda path: str(tmp_path / "cache" / "it.pyc"))
    monkeypatch.setattr("sys.dont_write_bytecode", False)
    (tmp_path / "cache").mkdir()
    return tmp_path / "cache"


def rendered(text: str = "{{ 1 + 1 }}") -> Any:
    return (
        Environment(loader=DictLoader({"it": text}), bytecode_cache=TemplateCache())
        .get_template("it")
        .render()
    )


def test_a_template_is_compiled_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rendered()
    monkeypatch.setattr(Environment, "compile", None)

    assert rendered() == "2"


def test_a_template_that_has_changed_is_compiled_again(folder: Path) -> None:
    rendered()

    assert rendered("{{ 1 + 2 }}") == "3"


@pytest.mark.parametrize("keep", [0, 10, -10])
def test_a_damaged_file_is_compiled_again(folder: Path, keep: int) -> None:
    rendered()
    (file,) = folder.iterdir()
    file.write_bytes(file.read_bytes()[:keep])

    assert rendered() == "2"


def test_a_template_is_compiled_where_nothing_can_be_kept(folder: Path) -> None:
    folder.rmdir()
    folder.write_text("no folder")

    assert rendered() == "2"


def test_nothing_is_kept_where_python_keeps_no_modules(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.dont_write_bytecode", True)

    assert rendered() == "2"
    assert not list(folder.iterdir())
