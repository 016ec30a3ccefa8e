"""At the prompt each kind lists its members, a line for each, and completes their names."""

import subprocess
import sys

import pytest

import servobench as sb

KINDS = (
    "controllers", "devices", "estimators", "exports", "faults", "formats", "signals", "structures", "studies",
)  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_lists_its_members_with_what_each_is(kind: str) -> None:
    registry = getattr(sb, kind)
    lines = repr(registry).splitlines()

    assert kind in dir(sb)
    for name, line in zip(registry.names(), lines, strict=False):
        assert line.startswith(f"{name} ")
        assert registry.sentence(name) in line
        assert len(registry.sentence(name)) > 10


@pytest.mark.parametrize("kind", KINDS)
def test_a_notebook_completes_the_names(kind: str) -> None:
    registry = getattr(sb, kind)

    assert registry._ipython_key_completions_() == list(registry.names())
    assert registry[registry.names()[0]] is not None


def test_importing_the_package_still_costs_next_to_nothing() -> None:
    script = (
        "import sys, servobench\nprint(sorted({'numpy', 'numba', 'pydantic', 'scipy'} & set(sys.modules)))"
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)

    assert ended.stdout.strip() == "[]"
