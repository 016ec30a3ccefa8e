"""The report is small however many motors there are, and says what they are like."""

import csv
from pathlib import Path

import numpy as np
import pytest

from servobench.fleet.figures import control_chart
from servobench.fleet.limits import Limits
from servobench.fleet.page import html_of, order_of, outcome_text, parameter_text, risks_of
from servobench.fleet.parts import Results
from servobench.fleet.table import Fleet, fleet_in, write_tables

LIMITS = Limits.parse({"gain": {"low": 19.0, "high": 21.0}})


def write_rows(folder: Path, count: int, *, drift: float = 0.0) -> Path:
    """Write a table of motors of 20 ± 0.5 rad/(s·V), known to ± 0.1, without recordings."""
    random = np.random.default_rng(9)
    with Results(folder / "out", {"source": "/stand", "pattern": "{serial}_{date}.csv"}) as results:
        for serial in range(count):
            gain, tau = random.normal(20.0, 0.5) + drift * serial / count, random.normal(0.1, 0.002)
            date = f"2026-11-{1 + 28 * serial // count:02}"
            results.add({
                "file": f"{serial}_{date}.csv", "serial": str(serial), "date": date, "outcome": "identified",
                "verdict": "trusted", "reason": "", "stamp": "1-1", "cpu_seconds": 0.05, "findings": ["structure-chosen"],
                "gain": gain, "gain_sd": 0.05, "gain_low": gain - 0.1, "gain_high": gain + 0.1, "gain_unit": "rad/(s·V)",
                "gain_state": "known", "time_constant": tau, "time_constant_sd": 1e-4, "time_constant_low": tau - 2e-4,
                "time_constant_high": tau + 2e-4, "time_constant_unit": "s", "time_constant_state": "known",
            })  # fmt: skip
    return folder / "out"


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Fleet:
    """Twenty thousand motors."""
    return fleet_in(write_rows(tmp_path_factory.mktemp("many"), 20_000), LIMITS)


def test_twenty_thousand_motors_are_a_page_of_less_than_3_mb(many: Fleet) -> None:
    text = html_of(many, "/stand", (), "servobench fleet stand")

    assert len(text.encode("utf-8")) < 3e6
    assert "20000 motors" in text
    assert text.count("<svg viewBox") == 8  # two figures of two parameters, wide and narrow


def test_a_page_of_a_hundred_is_about_as_large(many: Fleet, tmp_path: Path) -> None:
    few = html_of(fleet_in(write_rows(tmp_path, 100), LIMITS), "/stand", (), "")

    assert len(html_of(many, "/stand", (), "")) < 2 * len(few)


def test_the_risks_are_those_that_the_decisions_bear_out(many: Fleet) -> None:
    """The sd of a share p of 20,000 motors is sqrt(p (1 - p)/20,000), at most 0.35 %; four of these, and as much again for the
    spread that the risks estimate from the same motors."""
    (gain,) = [each for each in many.parameters if each.name == "gain"]
    risks = risks_of(many, gain)
    decided = many.counts("decisions")

    assert risks is not None
    assert risks.undecided == pytest.approx(decided["undecided"] / 20_000, abs=0.01)
    assert risks.consumer < 1e-3
    assert f"{decided['pass']} pass, {decided['fail']} fail" in outcome_text(many)


def test_the_table_has_a_row_for_each_and_what_is_known_of_all(tmp_path: Path) -> None:
    import pandas

    out = write_rows(tmp_path, 50)
    write_tables(out, fleet_in(out, LIMITS))
    table = pandas.read_parquet(out / "motors.parquet")

    assert len(table) == 50
    assert list(table.columns[:6]) == ["file", "serial", "date", "decision", "decided_by", "rule"]
    assert set(table["decision"]) <= {"pass", "fail", "undecided"}
    passed = table[table["decision"] == "pass"]
    assert (passed["consumer_risk"] <= 0.1).all()
    assert np.isfinite(table["distance"]).all()


def test_motors_are_ordered_by_date_and_then_as_people_count(tmp_path: Path) -> None:
    order, along = order_of(fleet_in(write_rows(tmp_path, 40)))

    assert along == "date and serial"
    assert order.tolist() == list(range(40))


def test_a_drift_is_reported_and_its_absence_isn_t() -> None:
    """Of 100 steady productions one shows a drift by chance, of 40 three or more once in 130 times."""
    random = np.random.default_rng(4)
    drifting = control_chart(random.normal(size=5000) + np.linspace(0, 1, 5000))
    steady = [control_chart(random.normal(size=500)) for _ in range(40)]

    assert drifting is not None
    assert drifting.drift == pytest.approx(1.0, abs=0.15)
    assert sum(chart is not None and chart.drift is not None for chart in steady) <= 2


def test_a_steady_production_lies_within_its_limits() -> None:
    """A mean is outside 3 σ once in 370; σ itself is known to some per cent. Of 100 points three or more are rare."""
    chart = control_chart(np.random.default_rng(6).normal(20, 0.5, 20_000))

    assert chart is not None
    assert chart.size == 200
    assert len(chart.mean) == 100
    assert chart.reach == pytest.approx(3 * 0.5 / np.sqrt(200), rel=0.05)
    assert chart.outside <= 3
    assert control_chart(np.arange(7.0)) is None


def speed_rows(folder: Path, levels: tuple[float, ...]) -> Path:
    """Write a table of motors whose speeds, 10 rad/s a volt, are known at one level [V] each."""
    with Results(folder / "levels", {"source": "/stand", "pattern": None}) as results:
        for number, level in enumerate(levels):
            speed = 10.0 * level
            results.add({
                "file": f"{number}.csv", "outcome": "identified", "verdict": "trusted", "reason": "", "stamp": "1-1",
                "speed_at_level": speed, "speed_at_level_sd": 0.5, "speed_at_level_low": speed - 1.0,
                "speed_at_level_high": speed + 1.0, "speed_at_level_unit": "rad/s", "speed_at_level_state": "known",
                "speed_at_level_input": level, "speed_at_level_input_unit": "V",
            })  # fmt: skip
    return folder / "levels"


def test_speeds_at_different_levels_are_not_pooled(tmp_path: Path) -> None:
    found = fleet_in(speed_rows(tmp_path, (3.0, 6.0, 3.05, -6.0, 6.1)))

    assert {each.name: each.value[np.isfinite(each.value)].tolist() for each in found.parameters} == {
        "speed_at_-6_V": [-60.0],
        "speed_at_3.025_V": pytest.approx([30.0, 30.5]),
        "speed_at_6.05_V": pytest.approx([60.0, 61.0]),
    }
    assert parameter_text(found, found.parameters[1]).startswith("speed at 3.025 V: median 30.25")


def test_speeds_at_one_level_stay_one_parameter(tmp_path: Path) -> None:
    (found,) = fleet_in(speed_rows(tmp_path, (6.0, 6.1, 5.99))).parameters

    assert found.name == "speed_at_level"
    assert np.isfinite(found.value).all()


def test_the_tables_have_the_level_beside_the_speed(tmp_path: Path) -> None:
    results = speed_rows(tmp_path, (3.0, 6.0))
    _, sheet = write_tables(results, fleet_in(results))

    heads, first, _ = csv.reader(sheet.read_text(encoding="utf-8-sig").splitlines())
    row = dict(zip(heads, first, strict=True))
    assert (row["speed_at_level"], row["speed_at_level_input"], row["speed_at_level_input_unit"]) == (
        "30.0", "3.0", "V",
    )  # fmt: skip
    assert heads.index("speed_at_level_input") < heads.index("stamp")
