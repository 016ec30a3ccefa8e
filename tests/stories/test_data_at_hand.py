"""The stories of people who have data and a Python prompt: arrays, a DataFrame, a folder of files, a notebook."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path

import jupytext
import nbformat
import numpy as np
import pandas
import pytest
from nbclient import NotebookClient

from tests.datasets import dataset
from tests.docs.pages import Reader
from tests.rig.motor.reference import Truth
from tests.stories.scripts import run_script

ROOT = Path(__file__).resolve().parents[2]
TRUTH = Truth()
_DRAG = TRUTH.resistance * TRUTH.viscous_friction + TRUTH.motor_constant**2
GAIN = TRUTH.motor_constant / _DRAG  # rad/(s·V)
# The slower pole of L J s² + (R J + L b) s + R b + k²; the winding's is 700 times as fast, and counts as delay.
TIME_CONSTANT = 1 / min(
    abs(
        np.roots(
            [
                TRUTH.inductance * TRUTH.inertia,
                TRUTH.resistance * TRUTH.inertia + TRUTH.inductance * TRUTH.viscous_friction,
                _DRAG,
            ]
        )
    )
)  # s


def angle_table(seed: int, samples: int = 3000) -> pandas.DataFrame:
    """A record of the reference motor as a logger writes it."""
    data = dataset(seed=seed, kind="prbs", samples=samples)
    return pandas.DataFrame({"time": data.t_output, "voltage": data.u, "angle": np.degrees(data.y)})


def numbers(printed: str) -> list[float]:
    return [float(word) for word in printed.split()]


def assert_holds_the_truth(printed: str) -> None:
    """`printed` has the ends of the intervals of gain and time constant, widened from 95 % to 3 sd: 1.5 half-widths."""
    values = numbers(printed)
    for (low, high), true in zip((values[:2], values[2:]), (GAIN, TIME_CONSTANT), strict=True):
        assert abs(0.5 * (low + high) - true) < 1.53 * 0.5 * (high - low)


INTERVALS = """
for name in ("gain", "time_constant"):
    print(*result[name].interval)
"""


def test_arrays_become_a_model_in_two_lines(tmp_path: Path, python: Path) -> None:
    table = angle_table(seed=1)
    np.savez(tmp_path / "log.npz", t=table["time"], u=table["voltage"], y=table["angle"])

    printed = run_script(
        "import numpy as np; log = np.load('log.npz'); t, u, y = log['t'], log['u'], log['y']\n"
        "import servobench as sb\n"
        "result = sb.identify(t=t, u=u, y=y, input_unit='V', output_unit='deg')\n" + INTERVALS,
        tmp_path,
        python,
    )

    assert_holds_the_truth(printed)


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_a_frame_becomes_a_model_a_picture_and_a_frame(library: str, tmp_path: Path, python: Path) -> None:
    angle_table(seed=2).to_csv(tmp_path / "log.csv", index=False)

    printed = run_script(
        f"import {library}; frame = {library}.read_csv('log.csv')\n"
        "import servobench as sb\n"
        "result = sb.identify(frame, output='angle:deg')\n"
        "result.plot()[0].figure.savefig('fit.png')\n"
        "assert list(result.to_frame().index)[:2] == ['gain', 'time_constant']\n" + INTERVALS,
        tmp_path,
        python,
    )

    assert_holds_the_truth(printed)
    assert (tmp_path / "fit.png").read_bytes().startswith(b"\x89PNG")


def test_a_folder_becomes_a_table_in_which_a_bad_file_is_a_row(tmp_path: Path, python: Path) -> None:
    """bench/folder.py measures the cost of a file, for 500 of them."""
    for serial in range(6):
        angle_table(seed=serial, samples=1500).to_csv(tmp_path / f"motor_{serial}.csv", index=False)
    (tmp_path / "motor_3.csv").write_text("nothing,here\n")

    printed = run_script(
        "from pathlib import Path\n"
        "import servobench as sb\n"
        "for path in sorted(Path('.').glob('motor_*.csv')):\n"
        "    try:\n"
        "        result = sb.identify(path, output='angle:deg')\n"
        "        print(path.name, result['gain'].value, result['gain'].sd)\n"
        "    except ValueError as error:\n"
        "        print(path.name, 'error', str(error).splitlines()[0])\n",
        tmp_path,
        python,
    )

    rows = [line.split() for line in printed.splitlines()]
    assert [row[0] for row in rows] == [f"motor_{serial}.csv" for serial in range(6)]
    assert [row[0] for row in rows if row[1] == "error"] == ["motor_3.csv"]
    for row in rows:
        if row[1] != "error":
            # 5 records: beyond 4 sd one in 3,000 times.
            assert abs(float(row[1]) - GAIN) < 4 * float(row[2])


NOTEBOOKS = {page.stem: page for page in sorted((ROOT / "docs" / "notebooks").glob("*.md"))}
LONG = {"design"}
"""Notebooks of many runs."""
SHOWN = "arrays"
"""The notebook whose result is looked at as a cell of its own."""


@cache
def outputs_in_jupyter(name: str) -> list[list[nbformat.NotebookNode]]:
    """What each cell of a notebook puts out, of `SHOWN` also what a last one with its result does.

    A cell that fails raises, and so does one that warns.
    """
    notebook = jupytext.read(NOTEBOOKS[name])
    notebook.cells.insert(0, nbformat.v4.new_code_cell("import warnings\nwarnings.simplefilter('error')"))
    if name == SHOWN:
        notebook.cells.append(nbformat.v4.new_code_cell("result"))
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "80")
        place = {"metadata": {"path": folder}}
        done = NotebookClient(notebook, timeout=300, kernel_name="python3", resources=place).execute()
    _, *outputs = [cell.outputs for cell in done.cells if cell.cell_type == "code"]
    return outputs


def test_jupyter_shows_a_result_as_a_table() -> None:
    *_, (shown,) = outputs_in_jupyter(SHOWN)

    assert "<table" in shown["data"]["text/html"]
    assert "23.69" in shown["data"]["text/html"]


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] if name in LONG else []) for name in NOTEBOOKS]
)
def test_every_notebook_runs_in_a_kernel_of_jupyter_and_prints_what_it_shows(
    name: str, tmp_path: Path
) -> None:
    printed = [
        "".join(output.text for output in outputs if output.output_type == "stream")
        for outputs in outputs_in_jupyter(name)
    ]

    assert len(printed) >= 3
    Reader(tmp_path).compare_cells(NOTEBOOKS[name], printed)
