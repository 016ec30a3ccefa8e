"""The house in order: lock file, public names, decision records, links, and no binaries in the tree."""

import functools
import importlib.util
import shutil
import subprocess
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parent.parent
LARGEST_PICTURE = 300_000  # bytes; enough for a screenshot of a report, too little for a video


@functools.cache
def tool(name: str) -> ModuleType:
    """Import `tools/<name>.py`, which is no part of the package, once: what it has found in the source it needn't find again."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def tracked_files() -> list[Path]:
    """Return the files that git knows or would add."""
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("no git checkout: the tree cannot be told from what was built in it")
    listing = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(listing, cwd=ROOT, capture_output=True, check=True).stdout.split(b"\0")
    return [path for name in names if name and (path := ROOT / name.decode()).is_file()]


def test_lock_file_holds_hashed_pins_of_all_that_is_asked_for_and_no_address() -> None:
    assert tool("check_lock").problems() == []


@pytest.mark.parametrize(
    "line",
    [
        "numpy==2.4.6",  # no hash follows
        "numpy>=2 \\",
        "-r other.txt",
        "numpy @ https://example.org/numpy.whl \\",
        "    # via -r /home/somebody/requirements.in",
        "# from https://example.org",
        "./wheels/numpy.whl",
    ],
)
def test_a_line_with_an_address_or_without_a_hash_does_not_pass_as_locked(line: str) -> None:
    assert len(tool("check_lock").problems_of_lines(line)) == 1


def test_every_link_leads_somewhere_and_every_decision_record_is_complete() -> None:
    assert tool("check_docs").problems() == []


def test_a_broken_link_a_missing_heading_and_an_incomplete_record_are_found(tmp_path: Path) -> None:
    check_docs = tool("check_docs")
    records = tmp_path / "docs" / "decisions"
    records.mkdir(parents=True)
    (records / "0001-short.md").write_text("# Short\n\n## Context\n", encoding="utf-8")
    (records / "Second.md").write_text("# Second\n", encoding="utf-8")
    (tmp_path / "README.md").write_text(
        "# What `it` is, and how\n\n[good](#what-it-is-and-how) [file](docs/decisions/Second.md#second)\n"
        "[gone](gone.md) ![gone](gone.png) [away](docs/decisions/Second.md#third)\n"
        "[elsewhere](https://example.org/gone)\n\n```\n[code](gone.md)\n```\n",
        encoding="utf-8",
    )

    problems = check_docs.problems(tmp_path)

    assert [line.split(";")[0] for line in problems if line.startswith("README.md")] == [
        "README.md:4: no such file: gone.md",
        "README.md:4: no such file: gone.png",
        "README.md:4: no such heading: docs/decisions/Second.md#third",
    ]
    assert [line.partition(":")[0] for line in problems[3:]] == ["0001-short.md", "Second.md"]


def test_every_exported_name_can_be_imported() -> None:
    import servobench

    assert servobench.__all__
    assert [name for name in servobench.__all__ if not hasattr(servobench, name)] == []
    assert len(set(servobench.__all__)) == len(servobench.__all__)


def test_the_version_of_the_package_is_the_installed_one() -> None:
    from importlib.metadata import version

    from servobench._version import __version__

    assert version("servobench") == __version__


def test_the_tree_holds_no_binaries_but_small_pictures_in_docs() -> None:
    binaries = [
        path.relative_to(ROOT)
        for path in tracked_files()
        if b"\0" in path.read_bytes()[:8000] and not path.is_relative_to(ROOT / "tests")
    ]

    pictures = [path for path in binaries if path.suffix == ".png" and path.parts[0] == "docs"]
    assert [path for path in binaries if path not in pictures] == []
    assert [path for path in pictures if (ROOT / path).stat().st_size > LARGEST_PICTURE] == []
