"""The peer table: its simulator against algebra and the finely stepped reference, its arithmetic by hand. No peer is needed."""

from __future__ import annotations

import csv
import importlib
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from tests.rig.motor.reference import Truth, march

PEERS = Path(__file__).resolve().parent.parent.parent / "bench" / "peers"


@pytest.fixture
def peers(monkeypatch: pytest.MonkeyPatch) -> Iterator[SimpleNamespace]:
    """Return the modules of `bench/peers`, imported as they are when it runs; none of them stays imported."""
    names = ("make_data", "page", "record", "run", "table", "worker")
    for name in names:
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.syspath_prepend(str(PEERS))
    yield SimpleNamespace(**{name: importlib.import_module(name) for name in names})
    for name in names:
        sys.modules.pop(name, None)


def motor(make_data: ModuleType, runs: int = 1, **others: float) -> object:
    return make_data.Motors(inertia=np.full(runs, 2.1e-5), motor_constant=np.full(runs, 0.042), **others)


# The simulator


def test_a_motor_without_friction_follows_the_exponential(peers: SimpleNamespace) -> None:
    free = motor(peers.make_data, coulomb_torque=0.0)
    k, tau, t = free.gain[0], free.time_constant[0], 0.002 * np.arange(500)

    angle = peers.make_data.simulate(free, np.full((1, 500), 3.0), np.zeros(1), np.array([10.0]))[0]

    # Rounding only: ten thousand sub-steps of some ulp of 60 rad.
    exact = 3.0 * k * t + (10.0 - 3.0 * k) * tau * -np.expm1(-t / tau)
    assert np.abs(angle - exact).max() < 1e-9


def test_gain_and_time_constant_are_those_of_the_reference_set_up(peers: SimpleNamespace) -> None:
    reference = motor(peers.make_data)

    assert reference.gain[0] == pytest.approx(23.2558, abs=5e-5)
    assert reference.time_constant[0] == pytest.approx(0.097674, abs=5e-7)
    assert reference.coulomb_voltage[0] == pytest.approx(0.300, abs=5e-13)


def test_a_coasting_motor_stops_when_and_where_algebra_says_and_stays(peers: SimpleNamespace) -> None:
    coasting = motor(peers.make_data)
    k, tau, lost = coasting.gain[0], coasting.time_constant[0], coasting.coulomb_voltage[0]
    stop = tau * math.log1p(20.0 / (k * lost))
    way = 20.0 * tau - k * lost * stop
    below = np.concatenate([np.zeros(200), np.full(200, 0.99 * lost)])[None]

    angle = peers.make_data.simulate(coasting, below, np.zeros(1), np.array([20.0]))[0]

    after = 0.002 * np.arange(400) > stop
    assert 0 < after.sum() < 400
    assert np.abs(angle[after] - way).max() < 1e-12


def test_reversals_agree_with_the_finely_stepped_reference(peers: SimpleNamespace) -> None:
    u = np.where((0.4 * 0.002 * np.arange(2500)) % 1.0 < 0.5, 3.0, -3.0)
    truth = Truth(
        inductance=1e-9, inertia=2.1e-5, motor_constant=0.042, viscous_friction=5e-6, coulomb_torque=1.5e-3
    )

    fine = march(truth, u, 0.002, step=2e-6)[:, 2]
    ours = peers.make_data.simulate(motor(peers.make_data), u[None], np.zeros(1), np.zeros(1))[0]

    # The reference is late by at most half its step, 1 µs, at each of four changes of the speed by at most 126 rad/s.
    assert np.abs(ours - fine).max() < 4 * 1e-6 * 126.0


def test_a_random_torque_spreads_the_speed_as_its_intensity_says(peers: SimpleNamespace) -> None:
    make_data, runs, samples = peers.make_data, 60, 1500
    noisy = motor(make_data, runs)
    q = (1e-5 / 2.1e-5) ** 2
    kicks = np.random.default_rng(3).standard_normal((runs, samples, make_data.SUBSTEPS))
    kicks *= math.sqrt(q * 0.002 / make_data.SUBSTEPS)
    u, rest = np.full((runs, samples), 2.0), np.zeros(runs)
    start = noisy.gain * (2.0 - noisy.coulomb_voltage)

    wander = make_data.simulate(noisy, u, rest, start, kicks) - make_data.simulate(noisy, u, rest, start)

    # θ integrates a first-order process that starts at rest: var θ = q τ² (t - 2τ(1 - e) + τ(1 - e²)/2), e = exp(-t/τ).
    tau, t = noisy.time_constant[0], 0.002 * (samples - 1)
    e = math.exp(-t / tau)
    expected = q * tau**2 * (t - 2.0 * tau * (1.0 - e) + 0.5 * tau * (1.0 - e**2))
    # 60 runs: a relative sd of sqrt(2/60) = 0.18, four of them.
    assert np.mean(wander[:, -1] ** 2) == pytest.approx(expected, rel=4 * math.sqrt(2.0 / runs))


def test_more_runs_leave_the_first_ones_as_they_were(peers: SimpleNamespace) -> None:
    for name in peers.make_data.SETS:
        few, more = (peers.make_data.records(name, runs, samples=50) for runs in (2, 4))

        assert np.array_equal(more.counts[:2], few.counts)
        assert np.array_equal(more.gain[:2], few.gain)
        assert len(set(more.gain)) == 4


def test_all_formats_hold_the_same_data(peers: SimpleNamespace, tmp_path: Path) -> None:
    from scipy.io import loadmat

    peers.make_data.write(tmp_path, 2, samples=20)

    truth = peers.table.read_truth(tmp_path / "truth.csv")
    assert set(truth) == {(name, run) for name in peers.make_data.SETS for run in (0, 1)}
    for name in peers.make_data.SETS:
        matlab = loadmat(tmp_path / f"{name}.mat")
        with np.load(tmp_path / f"{name}.npz") as arrays:
            rows = np.loadtxt(tmp_path / "csv" / f"{name}_001.csv", delimiter=",", skiprows=1)
            assert (
                np.abs(rows[:, 0] - arrays["t"]).max() < 1e-12
            )  # three decimals hold a time exactly, but for rounding
            assert np.array_equal(rows[:, 1:], np.column_stack([arrays["u"][1], arrays["counts"][1]]))
            assert np.array_equal(matlab["counts"], arrays["counts"])


# What a peer gets and gives


@pytest.mark.parametrize("forward", [False, True])
def test_the_speed_of_a_linear_motor_is_exactly_one_pole_and_two_terms(
    peers: SimpleNamespace, forward: bool
) -> None:
    make_data = peers.make_data
    free = motor(make_data, coulomb_torque=0.0)
    u = np.random.default_rng(5).choice([-1.0, 1.0, 2.0], (1, 300))
    angle = make_data.simulate(free, u, np.zeros(1), np.array([7.0]))[0]
    record = peers.record.Record(t=0.002 * np.arange(300), u=u[0], counts=angle / peers.record.QUANTUM)
    answers = []

    def regression(u, y, sample_time):  # type: ignore[no-untyped-def]
        first, second = (u[1:], u[:-1]) if forward else (u[1:-1], u[:-2])
        y = y if forward else y[1:]
        rows = np.column_stack([y[:-1], first, second])
        (a, b1, b2), *_ = np.linalg.lstsq(rows, y[1:], rcond=None)
        answers.append(peers.record.answer_of(a, (b1 + b2) / (1.0 - a), sample_time))
        return answers[-1]

    raw = peers.record.both_ways("method", regression, forward=forward)["method"](record)

    # The difference of two angles of 30 rad loses some 1e-14/0.002 s of a speed of 20 rad/s: 1e-12, more by 1/(1 - a) = 50.
    assert raw.gain == pytest.approx(free.gain[0], rel=1e-8)
    assert raw.time_constant == pytest.approx(free.time_constant[0], rel=1e-8)


@pytest.mark.parametrize("pole", [-0.5, 1.01, 0.0, 0.9 + 0.1j])
def test_a_pole_of_no_lag_is_no_answer(peers: SimpleNamespace, pole: complex) -> None:
    with pytest.raises(peers.record.NoAnswer, match="isn't a first-order lag"):
        peers.record.time_constant_of(complex(pole), 0.002)


def test_a_peer_that_fails_gives_a_row_that_says_why(peers: SimpleNamespace) -> None:
    def broken(_: object) -> object:
        raise RuntimeError("no licence")

    def leaves(_: object) -> object:
        sys.exit("bad order")

    assert peers.worker.outcome(broken, None)["status"] == "failed: RuntimeError: no licence"
    assert peers.worker.outcome(leaves, None)["status"] == "failed: SystemExit: bad order"


# The processes

SLOW_WORKER = """
import json, sys, time
for run in range(int(sys.argv[4]), 4):
    if run % 2:
        time.sleep(600)
    print(json.dumps({"run": run, "status": "ok"}), flush=True)
"""


def task(peers: SimpleNamespace, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, worker: str) -> object:
    (tmp_path / "worker.py").write_text(worker, encoding="utf-8")
    monkeypatch.setattr(peers.run, "HERE", tmp_path)
    return peers.run.Task(
        python=Path(sys.executable), tool="t", method="m", set="s", data=tmp_path, runs=4, limit=0.2
    )


def test_a_fit_that_takes_too_long_is_ended_and_the_next_run_is_tried(
    peers: SimpleNamespace, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(peers.run, "START", 5.0)  # both slow runs end with it at the latest

    found = list(peers.run.outcomes(task(peers, monkeypatch, tmp_path, SLOW_WORKER)))

    assert [one["run"] for one in found] == [0, 1, 2, 3]
    assert [str(one["status"]).split(":")[0] for one in found] == ["ok", "timed out", "ok", "timed out"]


def test_after_two_crashes_in_a_row_the_other_runs_are_not_tried(
    peers: SimpleNamespace, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    found = list(peers.run.outcomes(task(peers, monkeypatch, tmp_path, "raise SystemExit(3)")))

    assert [str(one["status"]).split(":")[0] for one in found] == [
        "crashed", "crashed", "not tried after 2 losses in a row", "not tried after 2 losses in a row",
    ]  # fmt: skip


# The arithmetic


def row(name: str, run: int, gain: float | None, half: float | None = None) -> dict[str, str]:
    """One answer on the set "s", whose truth is 100 for both parameters; None where there is no answer."""
    cells = dict.fromkeys(
        ("gain", "time_constant", "gain_low", "gain_high", "time_constant_low", "time_constant_high"), ""
    )
    if gain is not None:
        cells |= {"gain": repr(gain), "time_constant": repr(gain)}
    if gain is not None and half is not None:
        cells |= {f"{what}_low": repr(gain - half) for what in ("gain", "time_constant")}
        cells |= {f"{what}_high": repr(gain + half) for what in ("gain", "time_constant")}
    status = "ok" if gain is not None else "timed out: more than 30 s"
    more = {
        "date": "2026-01-01",
        "set": "s",
        "tool": name,
        "interval_from": "tool" if half else "",
        "note": "",
    }
    return {**cells, **more, "run": str(run), "method": name, "status": status, "seconds": "0.5"}


def truth_of(runs: int) -> dict[tuple[str, int], dict[str, float]]:
    return {("s", run): {"gain": 100.0, "time_constant": 100.0} for run in range(runs)}


def test_errors_are_percents_of_the_truth_and_no_answer_counts_as_a_hundred(peers: SimpleNamespace) -> None:
    rows = [row("a", 0, 103.0), row("a", 1, 96.0), row("a", 2, None)]

    errors = peers.table.percent_errors(rows, truth_of(4), "s", "gain")

    assert errors == pytest.approx([3.0, -4.0, 100.0, 100.0])
    assert peers.table.rmse(errors[:2]) == pytest.approx(math.sqrt(12.5))


def test_equal_values_share_a_rank(peers: SimpleNamespace) -> None:
    assert peers.table.ranks(np.array([[2.0], [1.0], [2.0], [5.0]])).ravel().tolist() == [2, 1, 2, 4]


def test_a_rank_is_certain_only_where_every_draw_agrees(peers: SimpleNamespace) -> None:
    random = np.random.default_rng(2)
    even = random.standard_normal((2, 30))
    errors = np.vstack([0.01 * np.ones(30), even])

    best, *others = peers.table.scores(errors, peers.table.draws(30), [0, 0, 0])

    assert peers.table.shown_rank(best.rank) == "1"
    assert [peers.table.shown_rank(other.rank) for other in others] == ["2-3", "2-3"]


def test_the_monte_carlo_error_of_an_rmse_is_that_of_normal_errors(peers: SimpleNamespace) -> None:
    errors = np.random.default_rng(4).standard_normal((1, 2000))

    (score,) = peers.table.scores(errors, peers.table.draws(2000, 500), [0])

    # sd of an RMSE of R normal errors: σ/sqrt(2R). Of 500 draws it is known to 1/sqrt(1000) = 3 %, the fourth moment of
    # 2,000 errors to about as much: four times both.
    assert score.rmse_sd == pytest.approx(1.0 / math.sqrt(4000.0), rel=4 * math.hypot(0.032, 0.035))


def test_coverage_counts_the_intervals_that_hold_the_truth(peers: SimpleNamespace) -> None:
    rows = [row("a", 0, 101.0, 2.0), row("a", 1, 104.0, 2.0), row("a", 2, None), row("a", 3, 100.5, 1.0)]

    (line,) = peers.table.lines(rows, truth_of(4), "s")

    assert (line.scores["gain"].covered, line.intervals, line.answers, line.runs) == (2, 3, 3, 4)
    assert "67, 67 %" in peers.table.markdown([line])
    assert "3/4 (timed out: more than 30 s)" in peers.table.markdown([line])


def test_methods_stand_in_the_order_of_their_errors_and_those_without_answers_last(
    peers: SimpleNamespace,
) -> None:
    rows = [
        row(name, run, gain)
        for name, gain in (("none", None), ("bad", 110.0), ("good", 100.1))
        for run in (0, 1)
    ]

    found = peers.table.lines(rows, truth_of(2), "s")

    assert [line.method for line in found] == ["good", "bad", "none"]
    assert "| none | none | none |" in peers.table.markdown(found)


@pytest.mark.parametrize("runs", [3, 30, 100])
def test_the_least_coverage_that_is_still_one_of_95_percent_is_the_binomial_quantile(
    peers: SimpleNamespace, runs: int
) -> None:
    assert peers.table.least_covered(runs) == stats.binom.ppf(0.025, runs, 0.95)


def test_an_rmse_is_shown_to_the_digit_that_its_monte_carlo_error_reaches(peers: SimpleNamespace) -> None:
    def shown(rmse: float, sd: float) -> str:
        score = peers.table.Score(median=0.0, rmse=rmse, rmse_sd=sd, rank=(1, 1), covered=0)
        return str(peers.table.shown_error(score))

    assert shown(0.0123456, 0.00234) == "0.0123 ± 0.0023"
    assert shown(123.4, 12.0) == "123 ± 12"


def test_the_matlab_scripts_write_the_columns_that_are_read(peers: SimpleNamespace) -> None:
    script = (PEERS / "matlab" / "run_peers.m").read_text(encoding="utf-8")

    head = script.partition("fprintf(file, ['")[2].partition("\\n']")[0]

    assert tuple("".join(part.strip("'. \n") for part in head.split("...")).split(",")) == peers.table.COLUMNS


def test_a_file_without_the_columns_is_not_added(peers: SimpleNamespace, tmp_path: Path) -> None:
    path = tmp_path / "results.csv"
    with open(path, "w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([["set", "run"], ["s", "0"]])

    with pytest.raises(SystemExit, match=r"no column date, gain"):
        peers.table.read_rows([path])


def test_answers_from_elsewhere_join_the_table(peers: SimpleNamespace, tmp_path: Path) -> None:
    peers.make_data.write(tmp_path, 2, samples=20)
    rows = [row("matlab", run, 23.0) | {"set": name} for name in peers.make_data.SETS for run in (0, 1)]
    peers.run.write_results(tmp_path / "from_matlab" / "results_matlab.csv", rows)
    page = tmp_path / "peers.md"

    peers.run.main([
        "--add", str(tmp_path / "from_matlab" / "results_matlab.csv"), "--folder", str(tmp_path), "--page", str(page),
    ])  # fmt: skip

    assert page.read_text(encoding="utf-8").count("| matlab | 1 | 1 |") == 3
    assert "- MATLAB" not in page.read_text(encoding="utf-8")


def test_the_page_says_where_servobench_stands_and_who_has_not_been_run(peers: SimpleNamespace) -> None:
    truth = {(name, run): value for name in peers.make_data.SETS for (_, run), value in truth_of(2).items()}
    rows = [
        row(tool, run, gain) | {"set": name}
        for name in peers.make_data.SETS
        for tool, gain in (("servobench_auto", 100.1), ("other", 105.0))
        for run in (0, 1)
    ]

    text = peers.page.page(rows, truth, PEERS / "requirements.txt", "7")

    assert "seed 7" in text
    assert text.count("`servobench_auto`: rank 1 for K and 1 for τ, of 2.") == 3
    assert "- CONTSID" in text
    assert "://" not in text
