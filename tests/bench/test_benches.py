"""The benches are found by themselves, and a limit that isn't kept shows in the exit status."""

import math
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from tests import forks

BENCH = Path(__file__).resolve().parent.parent.parent / "bench"


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """Return `bench/run.py`, which finds its neighbours as it does when it is run; none of them stays imported."""
    before = set(sys.modules)
    monkeypatch.syspath_prepend(str(BENCH))
    import run  # type: ignore[import-not-found]

    yield run
    for name in set(sys.modules) - before:
        if (
            getattr(sys.modules[name], "__file__", None)
            and Path(str(sys.modules[name].__file__)).parent == BENCH
        ):
            del sys.modules[name]


def test_every_file_but_the_runner_and_the_figures_is_a_bench(bench: ModuleType) -> None:
    assert "start_up" in bench.benches()
    assert not {"accusations", "figures", "run"} & set(bench.benches())
    for name in bench.benches():
        assert "def main(" in (BENCH / f"{name}.py").read_text(encoding="utf-8"), name


def test_the_status_is_that_of_the_worst_figure(
    bench: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    good = bench.Figure(what="good", value=2.0, half=(1.9, 2.1), unit="times", at_most=8.0)
    bad = bench.Figure(what="bad", value=0.80, at_least=0.91)

    assert bench.shown([good]) == 0
    assert bench.shown([good, bad]) == 1
    assert capsys.readouterr().out.count("NOT KEPT") == 1


def test_a_figure_that_is_no_number_keeps_to_no_limit(bench: ModuleType) -> None:
    assert not bench.Figure(what="lost", value=math.nan, at_most=1.0).is_kept


def test_a_bench_that_fails_doesn_t_stop_the_others(
    bench: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    good = ModuleType("good_bench")
    good.main = lambda: [bench.Figure(what="good", value=1.0, at_most=2.0)]  # type: ignore[attr-defined]
    bad = ModuleType("bad_bench")
    bad.main = lambda: 1 / 0  # type: ignore[attr-defined]
    for module in (good, bad):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(bench, "benches", lambda: ["bad_bench", "good_bench"])

    assert bench.main([]) == 1

    said = capsys.readouterr()
    assert "good" in said.out
    assert "bad_bench failed" in said.out
    assert "ZeroDivisionError" in said.err


def test_a_bench_that_there_isn_t_is_wrong_usage(
    bench: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    assert bench.main(["strat_up"]) == 2
    assert "start_up" in capsys.readouterr().err


sys.path.append(str(BENCH))  # as conftest.py does, for the names of the programs below
import run as runner  # noqa: E402

sys.path.remove(str(BENCH))
del sys.modules["run"], sys.modules["figures"]


HEAVY = {
    "accuracy.py", "board.py", "fleet.py", "panel.py", "paper_live.py", "peers/make_data.py", "peers/run.py", "population.py",
    "unseen.py", "warm.py",
}  # fmt: skip
"""Programs of more than two seconds at their smallest size; the parts of most have tests of their own."""


@pytest.mark.parametrize(
    "program",
    [pytest.param(each, marks=[pytest.mark.long] if each in HEAVY else []) for each in runner.programs()],
)
def test_every_program_below_the_benches_runs_at_its_smallest_size(program: str) -> None:
    """A change of the package that breaks a bench shows here, not months later."""
    done = forks.run([str(BENCH / "run.py"), "--smallest", program], cwd=Path.cwd(), timeout=1800)
    if "nothing was measured" in done.stderr:
        pytest.skip(done.stderr.strip().splitlines()[-1])

    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()


def test_the_programs_are_all_that_can_be_run_by_themselves(bench: ModuleType) -> None:
    assert {f"{name}.py" for name in bench.benches()} <= set(bench.programs())
    assert {"peers/run.py", "peers/worker.py", "peers/make_data.py"} <= set(bench.programs())


def test_a_program_without_a_smallest_size_fails(tmp_path: Path) -> None:
    copied = tmp_path / "bench"
    copied.mkdir()
    for name in ("run.py", "figures.py"):
        shutil.copy(BENCH / name, copied / name)
    (copied / "nothing.py").write_text(
        'def main(): ...\nif __name__ == "__main__": main()\n', encoding="utf-8"
    )

    done = subprocess.run(
        [sys.executable, str(copied / "run.py"), "--smallest", "nothing.py"], capture_output=True, text=True
    )

    assert done.returncode == 1
    assert "has no attribute 'smallest'" in done.stderr
