"""The Monte Carlo bench: what it counts, what it keeps, and what it writes."""

import json
from pathlib import Path
from typing import Any

import accuracy  # type: ignore[import-not-found]
import pytest
from accuracy_parts import page, storage, work  # type: ignore[import-not-found]
from accuracy_parts.rows import rows  # type: ignore[import-not-found]
from accuracy_parts.runs import one_run  # type: ignore[import-not-found]
from accuracy_parts.summary import Share, summarised  # type: ignore[import-not-found]

ENCODER = rows()[0]
CODES = {row.name: "code" for row in rows()}


def run(
    number: int = 0, *, off: float = 0.0, verdict: str = "trusted", sd: float = 0.01, **more: Any
) -> dict[str, Any]:
    """A run whose gain is off by so many of its standard deviations, held against a bound of one standard deviation."""
    gain = 10 * (1 + off * sd)
    return {
        "run": number,
        "truth": {"gain": (10.0, 10.0), "time_constant": (0.1, 0.1), "delay": 0.0},
        "bound": {"gain": sd, "time_constant": sd},
        "verdict": verdict,
        "structure": "first_order",
        "estimator": "output_error",
        "findings": {},
        "estimates": {
            "gain": [gain, 10 * sd, gain - 19.6 * sd, gain + 19.6 * sd],
            "time_constant": [0.1, 0.1 * sd, 0.1 - 0.196 * sd, 0.1 + 0.196 * sd],
        },
        **more,
    }  # fmt: skip


def test_rmse_and_bias_are_in_units_of_the_bound() -> None:
    found = summarised([run(off=3.0), run(off=-1.0)]).accuracy["gain"]

    assert found.rmse == pytest.approx(5**0.5)
    assert found.bias == pytest.approx(1.0)
    assert (found.coverage.count, found.coverage.of) == (1, 2)


def test_only_a_trusted_run_beyond_three_standard_deviations_is_trusted_and_wrong() -> None:
    runs = [run(off=3.1), run(off=2.9), run(off=9.0, verdict="doubtful"), run(off=0.1, verdict="doubtful")]

    found = summarised(runs)

    assert found.trusted_and_wrong.count == 1
    assert found.fine_but_not_trusted.count == 1
    assert found.error_when_wrong == pytest.approx(3.1)
    assert (found.coverage_given_trusted.count, found.coverage_given_trusted.of) == (2, 4)


def test_inside_a_range_of_true_values_nothing_is_wrong() -> None:
    truth = {"gain": (9.0, 11.0), "time_constant": (0.1, 0.1), "delay": 0.0}

    assert summarised([run(off=9.0, truth=truth)]).trusted_and_wrong.count == 0
    assert summarised([run(off=15.0, truth=truth)]).error_when_wrong == pytest.approx(100 * (11.5 - 11) / 10)


def test_a_run_without_a_fit_counts_as_failed_and_not_as_fine() -> None:
    refused = {key: value for key, value in run(verdict="refused").items() if key != "estimates"}

    found = summarised([run(), refused])

    assert (found.runs, found.failed) == (2, 1)
    assert found.fine_but_not_trusted.count == 0
    assert found.verdicts == {"trusted": 0.5, "refused": 0.5}


def test_the_range_of_a_share_is_wilsons() -> None:
    """The textbook's example: 0 of 10 leaves up to 27.8 %, 5 of 10 lies between 23.7 and 76.3 %."""
    assert Share(count=0, of=10).range == pytest.approx((0.0, 0.278), abs=5e-4)
    assert Share(count=5, of=10).range == pytest.approx((0.237, 0.763), abs=5e-4)


def test_an_interrupted_bench_goes_on_and_more_runs_extend_it(tmp_path: Path) -> None:
    work.done([ENCODER], 2, 1, tmp_path, CODES)
    first = json.loads((tmp_path / "encoder.json").read_text(encoding="utf-8"))["runs"]

    work.done([ENCODER], 3, 1, tmp_path, CODES)

    then = json.loads((tmp_path / "encoder.json").read_text(encoding="utf-8"))["runs"]
    assert [one["run"] for one in then] == [0, 1, 2]
    assert then[:2] == first  # the same to the time each took: they weren't done again
    assert {one["verdict"] for one in then} == {"trusted"}


def test_runs_of_other_code_and_files_that_are_cut_off_are_not_used(tmp_path: Path) -> None:
    code = storage.fingerprint(ENCODER)
    storage.keep(tmp_path, ENCODER, code, [run(1), run(0)])

    assert [one["run"] for one in storage.kept(tmp_path, ENCODER, code)] == [0, 1]
    assert storage.kept(tmp_path, ENCODER, "other") == []
    (tmp_path / "encoder.json").write_text('{"row": "enc', encoding="utf-8")
    assert storage.kept(tmp_path, ENCODER, code) == []


def test_two_rows_of_other_settings_have_other_fingerprints_and_other_seeds() -> None:
    assert len({storage.fingerprint(row) for row in rows()}) == len(rows())
    seeds = {row.base for row in rows()}
    assert len(seeds) == len(rows()) - 1  # the two rows of fine noise meet the same data


def test_the_page_shows_what_is_kept_and_marks_what_is_trusted_and_wrong(tmp_path: Path) -> None:
    storage.keep(tmp_path, ENCODER, "code", [run(0), run(1, off=8.0)])

    page.write(rows(), tmp_path, tmp_path, CODES)

    text = (tmp_path / "accuracy.md").read_text(encoding="utf-8")
    assert "encoder only" in text
    assert "**50.0 %" in text
    assert "0.3 count" not in text
    tables = [line.count("|") for line in text.splitlines() if line.startswith("| ")]
    assert sorted(set(tables)) == [
        9,
        12,
    ]  # every row has as many cells as its heading: 8 in one table, 11 in the other
    (row,) = json.loads((tmp_path / "accuracy.json").read_text(encoding="utf-8"))["rows"]
    assert row["trusted_and_wrong"] == {"count": 1, "of": 2}


@pytest.mark.parametrize("encoder", ["motor", "load"])
def test_play_of_six_degrees_is_not_taken_for_friction_that_is_known(encoder: str) -> None:
    """Under a square of one magnitude a reversal alone tells gain and friction apart, and that is where the play acts."""
    row = next(row for row in rows() if row.name == f"backlash_{encoder}_0.1_square")

    for number in range(4):
        kept = one_run(row, number)
        value, sd, *_ = kept["estimates"]["gain"]
        assert kept["verdict"] == "trusted"
        assert abs(value - kept["truth"]["gain"][0]) < 3 * sd


def test_rows_are_chosen_by_name_or_by_how_they_begin() -> None:
    assert [row.name for row in accuracy.chosen_rows(["torque*", "encoder"])] == [
        "torque_1e-7",
        "torque_1e-6",
        "torque_1e-5",
        "torque_1e-4",
        "encoder",
    ]
    with pytest.raises(SystemExit, match="strange"):
        accuracy.chosen_rows(["strange"])
