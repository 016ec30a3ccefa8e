"""`servobench identify`: files that somebody already has, from the question to the result."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Command, checked, in_a_fork


def table(file: Path, columns: dict[str, np.ndarray]) -> Path:
    """Write columns as a CSV file."""
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns), *(",".join(repr(float(x)) for x in row) for row in rows)]
    file.write_text("\n".join(lines) + "\n")
    return file


def motor(samples: int = 3000, sample_time: float = 0.01) -> dict[str, np.ndarray]:
    """Return t, u, the position and the speed of ω' = (K u - ω) / τ with K = 20 rad/(s·V), τ = 0.1 s, for steps of ±2 V.

    The exact solution for an input that holds between samples, from rest.
    """
    t = sample_time * np.arange(samples)
    u = np.where((t % 1.0) < 0.5, 2.0, -2.0)
    decay = np.exp(-sample_time / 0.1)
    omega, theta = np.zeros(samples), np.zeros(samples)
    for k in range(samples - 1):
        end = 20.0 * u[k]
        omega[k + 1] = end + (omega[k] - end) * decay
        theta[k + 1] = theta[k] + end * sample_time + (omega[k] - end) * 0.1 * (1 - decay)
    return {"t": t, "u": u, "theta": theta, "omega": omega}


def noisy(columns: dict[str, np.ndarray], seed: int = 1) -> dict[str, np.ndarray]:
    """Return the same with white noise of 0.02 rad on the position and 0.5 rad/s on the speed."""
    random = np.random.default_rng(seed)
    n = len(columns["t"])
    theta = columns["theta"] + 0.02 * random.standard_normal(n)
    return {**columns, "theta": theta, "omega": columns["omega"] + 0.5 * random.standard_normal(n)}


@pytest.fixture
def position(tmp_path: Path) -> Path:
    columns = noisy(motor())
    return table(
        tmp_path / "position.csv",
        {"t [s]": columns["t"], "u [V]": columns["u"], "theta [rad]": columns["theta"]},
    )


def test_a_clean_position_is_trusted_and_its_intervals_hold_the_truth(
    servobench: Command, position: Path
) -> None:
    ended = servobench("identify", position, "--json")

    result = ended.result
    assert (ended.status, result["verdict"]) == (0, "trusted")
    # 4 sd: this one seed is either in or out, and 1 of 16 000 is out.
    for name, truth in (("gain", 20.0), ("time_constant", 0.1), ("delay", 0.0)):
        estimate = result["parameters"][name]
        assert abs(estimate["value"] - truth) < 4 * estimate["sd"]
    assert result["provenance"]["inputs_sha256"] != []


def test_people_get_the_same_in_words(servobench: Command, position: Path) -> None:
    ended = servobench("identify", position)

    assert ended.status == 0
    assert ended.err == ""
    for words in ("gain", "time constant", "delay", "95 % interval", "rad/(s·V)", "G(s) = ", "trusted: "):
        assert words in ended.out


def test_a_speed_of_unknown_origin_is_a_result_that_says_so(servobench: Command, tmp_path: Path) -> None:
    columns = noisy(motor())
    file = table(tmp_path / "speed.csv", {name: columns[name] for name in ("t", "u", "omega")})

    ended = servobench("identify", file, "--output", "omega:rad/s", "--json")

    assert (ended.status, ended.result["verdict"]) == (0, "trusted")
    (chain,) = [each for each in ended.result["findings"] if each["code"] == "chain-unknown"]
    assert chain["severity"] == "info"
    assert chain["parameters"] == ["time_constant", "delay"]


def test_data_that_can_t_support_a_model_are_refused_with_json_and_report(
    servobench: Command, tmp_path: Path
) -> None:
    columns = motor()
    still = {"t": columns["t"], "u": np.full_like(columns["u"], 2.0), "theta": columns["theta"]}
    file, report = table(tmp_path / "still.csv", still), tmp_path / "report.html"

    ended = servobench("identify", file, "--output", "theta:rad", "--json", "--report", report)

    assert (ended.status, ended.result["verdict"]) == (3, "refused")
    assert ended.result["parameters"] == {}
    assert ended.result["transfer_function"] is None
    assert report.read_text(encoding="utf-8").startswith("<!")


def test_words_go_to_standard_error_beside_json(position: Path) -> None:
    ended = in_a_fork("identify", position, "--json")

    assert ended.status == 0
    assert checked(json.loads(ended.out))["verdict"] == "trusted"
    assert "trusted: " in ended.err
    assert ended.out.isascii()


def test_what_is_missing_is_asked_for_all_at_once(servobench: Command, tmp_path: Path) -> None:
    columns = motor(100)
    file = table(tmp_path / "bare.csv", {"a": columns["u"], "b": columns["theta"]})

    ended = servobench("identify", file)

    assert ended.status == 2
    assert ended.out == ""
    for option in ("--input", "--output", "--sample-time"):
        assert option in ended.err


def test_a_sample_time_may_have_a_unit(servobench: Command, tmp_path: Path) -> None:
    columns = noisy(motor())
    file = table(tmp_path / "bare.csv", {"a": columns["u"], "b": columns["theta"]})
    words = ("identify", file, "--input", "a:V", "--output", "2:rad", "--json", "--sample-time")

    assert servobench(*words, "10 ms").result["parameters"] == servobench(*words, "0.01").result["parameters"]


def test_a_chain_that_can_t_have_been_passed_is_applied_now_and_said(
    servobench: Command, position: Path
) -> None:
    ended = servobench("identify", position, "--chain", "derivative | lowpass 50 rad/s", "--json")

    result = ended.result
    told = {finding["code"]: finding["sentence"] for finding in result["findings"]}
    assert "`theta" in told["chain-applied"]
    # The prediction goes through the same chain, so that its 20 ms are in no parameter.
    assert (
        abs(result["parameters"]["time_constant"]["value"] - 0.1)
        < 4 * result["parameters"]["time_constant"]["sd"]
    )
    assert result["operating_range"]["speed"][1] == pytest.approx(40.0, rel=0.1)


def test_a_chain_that_a_speed_has_been_through_is_allowed_for(servobench: Command, tmp_path: Path) -> None:
    columns = motor()
    # The forward Euler low-pass of 5 rad/s, by its own difference equation: 0.2 s, twice the motor's time constant.
    filtered = np.zeros_like(columns["omega"])
    for k in range(1, len(filtered)):
        filtered[k] = filtered[k - 1] + 5.0 * 0.01 * (columns["omega"][k - 1] - filtered[k - 1])
    filtered += 0.05 * np.random.default_rng(3).standard_normal(len(filtered))
    file = table(tmp_path / "filtered.csv", {"t": columns["t"], "u": columns["u"], "omega": filtered})
    words = ("identify", file, "--output", "omega:rad/s", "--json")

    knowing = servobench(*words, "--chain", "lowpass 5 rad/s euler").result
    ignorant = servobench(*words).result

    assert "chain-applied" not in {finding["code"] for finding in knowing["findings"]}
    assert knowing["parameters"]["time_constant"]["value"] == pytest.approx(0.1, rel=0.02)
    assert ignorant["parameters"]["time_constant"]["value"] > 0.15


def test_counts_become_an_angle_by_a_chain_that_is_only_a_unit(servobench: Command, tmp_path: Path) -> None:
    columns = motor()
    counts = np.floor(columns["theta"] * 2048 / (2 * np.pi))
    file = table(tmp_path / "counts.csv", {"t": columns["t"], "u": columns["u"], "counts": counts})

    result = servobench(
        "identify", file, "--output", "counts:counts", "--chain", "scale 0.17578125 deg/count", "--json"
    ).result

    assert result["parameters"]["gain"]["unit"] == "rad/(s·V)"
    assert result["parameters"]["gain"]["value"] == pytest.approx(20.0, rel=1e-3)


def test_a_wrapped_counter_is_unwrapped_by_its_chain(servobench: Command, tmp_path: Path) -> None:
    columns = motor()
    columns["u"] = columns["u"] + 1.0  # it travels, and so wraps
    t, u = columns["t"], columns["u"]
    # Steps of 3 V and -1 V about a mean of 1 V: a superposition of the motor's response and of that to a constant 1 V.
    theta = columns["theta"] + 20.0 * (t - 0.1 * (1 - np.exp(-t / 0.1)))
    counts = np.floor(theta * 4096 / (2 * np.pi)) % 4096
    file = table(tmp_path / "wrapped.csv", {"t": t, "u": u, "counts": counts})

    result = servobench(
        "identify", file, "--output", "counts:counts", "--chain", "unwrap 12 bit", "--json"
    ).result

    gain = result["parameters"]["gain"]
    assert gain["value"] * 2 * np.pi / 4096 == pytest.approx(20.0, rel=1e-3)


def test_a_chain_that_isn_t_one_ends_with_2(servobench: Command, position: Path) -> None:
    assert "no stage called 'lowpas'" in servobench("identify", position, "--chain", "lowpas 50 rad/s").err


def test_several_files_are_fitted_jointly_and_others_validate(servobench: Command, tmp_path: Path) -> None:
    files = []
    for seed in (1, 2, 3):
        columns = noisy(motor(), seed)
        named = {"t [s]": columns["t"], "u [V]": columns["u"], "theta [rad]": columns["theta"]}
        files.append(table(tmp_path / f"run{seed}.csv", named))

    one = servobench("identify", files[0], "--json").result
    joint = servobench("identify", *files[:2], "--validate-with", files[2], "--json").result

    assert [record["name"] for record in joint["records"]] == ["run1", "run2"]
    assert joint["parameters"]["gain"]["sd"] < one["parameters"]["gain"]["sd"]
    assert [record["name"] for record in joint["validation"]["records"]] == ["run3"]


def test_one_recording_of_several_can_be_chosen(servobench: Command, tmp_path: Path) -> None:
    from dataclasses import replace

    import servobench as sb

    columns = noisy(motor())
    named = {"t [s]": columns["t"], "u [V]": columns["u"], "theta [rad]": columns["theta"]}
    (recording,) = sb.load(table(tmp_path / "a.csv", named))
    sb.save([recording, replace(recording, name="b")], tmp_path / "both.mcap")

    chosen = servobench("identify", tmp_path / "both.mcap", "--recording", "b", "--json").result
    unknown = servobench("identify", tmp_path / "both.mcap", "--recording", "c")

    assert [record["name"] for record in chosen["records"]] == ["b"]
    assert unknown.status == 2
    assert "no recording called 'c'" in unknown.err


def test_a_nominal_that_doesn_t_fit_the_units_ends_with_2(servobench: Command, tmp_path: Path) -> None:
    columns = motor()
    file = table(tmp_path / "cart.csv", {"t": columns["t"], "u": columns["u"], "x": columns["theta"]})

    ended = servobench("identify", file, "--output", "x:m", "--nominal", "qube_servo_2")

    assert ended.status == 2
    assert "a data sheet is in V and rad" in ended.err


def test_the_report_names_the_command_that_was_typed(
    servobench: Command, position: Path, tmp_path: Path
) -> None:
    report = tmp_path / "report.html"

    ended = servobench("identify", position, "--report", report)

    assert f"report: {report}" in ended.out
    assert f"servobench identify {position}" in report.read_text(encoding="utf-8")


def test_a_recording_of_ours_gives_the_result_of_its_run(servobench: Command, finished_run: Path) -> None:
    again = servobench("identify", finished_run / "recording.mcap", "--json").result

    first = json.loads((finished_run / "result.json").read_text(encoding="utf-8"))
    assert again["parameters"] == first["parameters"]
    assert again["provenance"]["inputs_sha256"] == first["provenance"]["inputs_sha256"]


def test_the_table_of_a_run_gives_the_result_of_its_recording(
    servobench: Command, finished_run: Path
) -> None:
    by_table = servobench("identify", finished_run / "data.csv", "--json").result
    by_recording = servobench("identify", finished_run / "recording.mcap", "--json").result

    assert by_table["parameters"] == by_recording["parameters"]


def test_a_report_is_never_written_over_a_recording(tmp_path: Path) -> None:
    recording = tmp_path / "a.csv"
    recording.write_text("t,u,y\n" + "".join(f"{0.01 * k},{1 + k // 50 % 2},{k}\n" for k in range(200)))
    before = recording.read_bytes()
    ended = in_a_fork("identify", recording, "--output", "y:rad", "--report", recording)
    assert ended.status == 2
    assert "would be overwritten" in ended.err
    assert recording.read_bytes() == before


def test_a_refused_result_tells_why_and_shows_no_figure(servobench: Command, tmp_path: Path) -> None:
    """Noise in place of the output: nothing is known, no G(s) in the terminal; who wants the numbers finds them in the JSON."""
    columns = motor()
    noise = np.random.default_rng(0).standard_normal(len(columns["t"]))
    file = table(tmp_path / "noise.csv", {"t [s]": columns["t"], "u [V]": columns["u"], "y [rad]": noise})

    ended = servobench("identify", file)

    assert ended.status == 3
    table_shown, refused, reasons = ended.out.partition("refused: ")
    assert refused
    assert "  ✗ " in reasons
    assert "G(s)" not in ended.out
    for row in table_shown.splitlines()[1:]:
        assert not row or "not known" in row or "at most" in row
    assert servobench("identify", file, "--json").result["parameters"]
