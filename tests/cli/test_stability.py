"""`servobench stability`: what is said of a run, a result and a recording, and what is refused."""

import json
import math
import re
from importlib.resources import files
from pathlib import Path
from typing import Any

import control
import jsonschema
import numpy as np
import pytest

from tests.cli.conftest import Command
from tests.export.conftest import known_together

_DIGITS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹", "0123456789")  # the minus before them stays


def test_a_run_and_its_result_say_the_same(servobench: Command, finished_run: Path) -> None:
    said = [servobench("stability", path) for path in (finished_run, finished_run / "result.json")]

    assert [each.status for each in said] == [0, 0]
    assert said[0].out == said[1].out
    assert "To the speed: stable, BIBO stable" in said[0].out
    assert "To the position: marginally stable, not BIBO stable" in said[0].out
    assert "A constant as input" in said[0].out
    assert "The position loop with 1 V/rad, computed every 2 ms: stable" in said[0].out


def test_a_recording_says_what_it_leaves_open_too(servobench: Command, finished_run: Path) -> None:
    said = servobench("stability", finished_run / "recording.mcap", "--kp", "2 V/rad")

    assert said.status == 0, said.err
    words = " ".join(said.out.split())
    assert "No finite record proves" in words
    assert "The position loop with 2 V/rad, computed every 2 ms: stable" in words
    assert "Over the 95 % intervals the closed loop is stable everywhere" in words


def test_too_much_gain_is_unstable_as_it_runs(servobench: Command, finished_run: Path) -> None:
    """z² - (1 + a - k c₁) z + a + k c₂ has |z| = 1 at k = (1 - a)/c₂ = 37 V/rad, h 2 ms, τ 0.1 s, K 24, without the delay."""
    for kp, verdict in (("30", "stable"), ("45", "unstable")):
        said = servobench("stability", finished_run, "--kp", kp)

        assert said.status == 0
        assert f"The position loop with {kp} V/rad, computed every 2 ms: {verdict}" in said.out
        words = " ".join(said.out.split())
        assert ("encircles −1 twice, clockwise" in words) == (verdict == "unstable")


def told(text: str) -> dict[str, Any]:
    """The document on standard output, which holds nothing else, checked by the packaged schema and for finite numbers."""
    schema = json.loads(
        files("servobench").joinpath("cli/schemas/stability-1.json").read_text(encoding="utf-8")
    )
    jsonschema.Draft202012Validator.check_schema(schema)
    found: dict[str, Any] = json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} isn't JSON"))
    jsonschema.Draft202012Validator(schema).validate(found)
    return found


def in_words(found: dict[str, Any]) -> list[str]:
    """All sentences of an answer."""
    systems = [
        [*each["reasons"], *([each["drive"]["sentence"]] if each["drive"] else [])]
        for each in found["systems"]
    ]
    records = [each["sentences"] for each in found["records"]]
    return [
        *(sentence for group in (*records, *systems) for sentence in group),
        *found["loop"]["sentences"],
        *(each["sentence"] for each in found["over_intervals"]),
    ]


@pytest.mark.parametrize("kp", ["2", "400", "-1"])
def test_json_says_what_the_words_do(servobench: Command, finished_run: Path, kp: str) -> None:
    plain = servobench("stability", finished_run, "--kp", kp)
    ended = servobench("stability", finished_run, "--kp", kp, "--json")

    found = told(ended.out)
    words = " ".join(plain.out.split())
    assert " ".join(ended.err.split()) == words
    assert (
        f"The position loop with {kp.replace('-', '−')} V/rad, computed every 2 ms: {found['loop']['verdict']}"
        in words
    )
    assert all(" ".join(sentence.split()) in words for sentence in in_words(found))
    assert (found["loop"]["margins"] is None) == (found["loop"]["verdict"] != "stable")
    assert found["records"] == found["over_intervals"] == []


def test_the_continuous_margins_are_those_of_python_control(servobench: Command, finished_run: Path) -> None:
    result = json.loads((finished_run / "result.json").read_text(encoding="utf-8"))["transfer_function"]

    found = told(servobench("stability", finished_run, "--kp", "5 V/rad", "--continuous", "--json").out)
    assert found["loop"]["sample_time"] is None

    # K e^(-ds)/(s (τs + 1)), the delay by Padé's approximation of order 6: at ωd < 0.1 its phase is right to 1e-13.
    loop = control.tf([5 * c for c in result["numerator"]], [*result["denominator"], 0])
    factor, degrees, at_phase, at_gain = control.margin(loop * control.tf(*control.pade(result["delay"], 6)))
    margins = {name: each["value"] for name, each in found["loop"]["margins"].items()}
    assert margins["gain_margin"] == pytest.approx(factor, rel=1e-5)
    assert math.degrees(margins["phase_margin"]) == pytest.approx(degrees, abs=1e-4)
    assert margins["delay_margin"] == pytest.approx(math.radians(degrees) / at_gain, rel=1e-5)
    assert (margins["gain_crossover"], margins["phase_crossover"]) == pytest.approx(
        (at_gain, at_phase), rel=1e-5
    )
    pole = -result["denominator"][1] / result["denominator"][0]
    assert [each["real"] for each in found["systems"][1]["poles"]] == pytest.approx([0, pole])


def swings(result: dict[str, Any], kp: float, extra: float, h: float) -> tuple[float, float]:
    """The largest angle in the fourth and in the last sixth of a run of u = -kp θ from 1 rad, tick by tick, by algebra."""
    (gain,), (tau, _), delay = result["numerator"], result["denominator"], result["delay"] + extra
    whole, part = divmod(delay, h)
    inputs, angle, speed, course = [0.0] * (int(whole) + 2), 1.0, 0.0, []
    for _ in range(6000):
        course.append(abs(angle))
        inputs = [-kp * angle, *inputs[:-1]]
        for volts, length in ((inputs[-1], part), (inputs[-2], h - part)):
            fall = 1 - math.exp(-length / tau)
            angle += gain * volts * length + tau * fall * (speed - gain * volts)
            speed += fall * (gain * volts - speed)
    return max(course[3000:4000]), max(course[5000:])


@pytest.mark.parametrize("ticks", [(), ("--controller-sample-time", "5 ms")], ids=str)
def test_the_loop_as_it_runs_bears_its_margins_and_no_more(
    servobench: Command, finished_run: Path, ticks: tuple[str, ...]
) -> None:
    """It said 62.5 of a loop that bears 7.46."""
    result = json.loads((finished_run / "result.json").read_text(encoding="utf-8"))["transfer_function"]
    found = told(servobench("stability", finished_run, "--kp", "5", *ticks, "--json").out)["loop"]
    h = 0.005 if ticks else 0.002

    assert found["sample_time"] == h
    factor, delay = (found["margins"][name]["value"] for name in ("gain_margin", "delay_margin"))
    for side, grows in ((0.99, False), (1.01, True)):
        early, late = swings(result, 5 * side * factor, 0.0, h)
        assert (late > early) == grows
        # Behind a part of a tick the delay margin leaves out (ωh/2π)² of the loop: 1e-4 at 10 rad/s.
        early, late = swings(result, 5.0, side * delay, h)
        assert (late > early) == grows


def test_a_continuous_loop_has_no_ticks(servobench: Command, finished_run: Path) -> None:
    ended = servobench("stability", finished_run, "--continuous", "--controller-sample-time", "2 ms")

    assert ended.status == 2
    assert "a continuous loop has no ticks" in " ".join(ended.err.split())


def test_json_of_a_recording_holds_what_the_record_says_and_what_it_leaves_open(
    servobench: Command, finished_run: Path
) -> None:
    ended = servobench("stability", finished_run / "recording.mcap", "--json")

    found = told(ended.out)
    words = " ".join(ended.err.split())
    assert all(" ".join(sentence.split()) in words for sentence in in_words(found))
    assert len(found["records"]) == 1
    assert [each["of"] for each in found["over_intervals"]] == ["speed", "position_loop"]


@pytest.mark.parametrize(
    ("words", "because"),
    [(("--kp", "2 A"), "--kp 2 A"), (("--kp", "0"), "there is no loop"), (("--kp", "much"), "--kp much")],
)
def test_a_gain_that_is_none_is_reported(
    servobench: Command, finished_run: Path, words: tuple[str, ...], because: str
) -> None:
    ended = servobench("stability", finished_run, *words)

    assert ended.status == 2
    assert because in ended.err
    assert "Traceback" not in ended.err


def test_a_result_that_is_not_there_is_reported(servobench: Command, tmp_path: Path) -> None:
    ended = servobench("stability", tmp_path / "nothing.json")

    assert ended.status == 2
    assert "there is no result" in ended.err


@pytest.fixture(scope="module")
def in_counts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A motor of 20 rad/(s·V) and 50 ms without friction behind 2048 counts/rev, switched between three levels both ways."""
    rate, gain, tau = 200, 20.0, 0.05
    t = np.arange(2000) / rate
    u = np.random.default_rng(1).choice([-4.0, -2.0, 2.0, 4.0], 100).repeat(20)
    decay = np.exp(-1 / (rate * tau))
    speed, angle = 0.0, 0.3
    angles = []
    for volts in u:  # exact for an input that is held
        angles.append(angle)
        final = gain * volts
        angle += final / rate + (speed - final) * tau * (1 - decay)
        speed = final + (speed - final) * decay
    counts = np.floor(np.array(angles) * 2048 / (2 * np.pi))
    path = tmp_path_factory.mktemp("counts") / "mine.csv"
    table = np.column_stack([t, u, counts])
    np.savetxt(path, table, delimiter=",", fmt="%.9g", header="Time,Voltage,enc", comments="")
    return path


# The loop of 20/(s (0.05 s + 1)): |L| = 1 at ω² = (√(1 + 4·(20·0.05)²) - 1)/(2·0.05²), φ = 90° - atan(0.05 ω) = 51.83°, and the
# hold of 5 ms takes half a tick, ωh/2 = 2.25°.
_MARGIN = "phase margin 49.6°"


def test_a_file_is_identified_with_the_options_that_identify_has(
    servobench: Command, in_counts: Path
) -> None:
    said = servobench("stability", in_counts, "--output", "enc:counts", "--counts-per-rev", "2048")

    assert said.status == 0, said.err
    assert _MARGIN in said.out
    assert "with 1 V/rad, computed every 5 ms: stable" in said.out


def test_a_result_in_counts_has_a_loop_in_counts(
    servobench: Command, in_counts: Path, tmp_path: Path
) -> None:
    found = servobench("identify", in_counts, "--output", "enc:counts", "--json")
    path = tmp_path / "result.json"
    path.write_text(found.out, encoding="utf-8")

    # 1 V/rad is 2 π/2048 V/count.
    said = servobench("stability", path, "--kp", "0.0030679616 V/counts")
    assert said.status == 0, said.err
    assert _MARGIN in said.out
    assert "V/counts, computed every 5 ms: stable" in said.out
    assert "--counts-per-rev" in said.out
    refused = servobench("stability", path, "--kp", "1 V/rad")
    assert refused.status == 2
    assert "V/counts" in refused.err


def test_counts_in_a_turn_are_those_of_counts(servobench: Command, in_counts: Path) -> None:
    rad = servobench(
        "identify", in_counts, "--output", "enc:counts", "--counts-per-rev", "2048", "--json"
    ).result
    assert rad["transfer_function"]["unit"] == "rad/(s·V)"
    assert rad["parameters"]["gain"]["value"] == pytest.approx(20, rel=1e-3)
    degrees = servobench("identify", in_counts, "--output", "enc:deg", "--counts-per-rev", "2048")
    assert degrees.status == 2
    assert "is in deg" in degrees.err
    unknown = servobench("identify", in_counts, "--output", "enc:rev/2048")
    assert unknown.status == 2
    assert "--counts-per-rev" in unknown.err
    nothing = servobench("identify", in_counts, "--output", "enc:counts", "--counts-per-rev", "0")
    assert nothing.status == 2
    assert "Traceback" not in nothing.err


def test_columns_of_a_result_are_refused(servobench: Command, finished_run: Path) -> None:
    ended = servobench("stability", finished_run, "--output", "enc:counts")

    assert ended.status == 2
    assert "which has no columns" in ended.err


def test_what_is_not_known_is_not_judged(servobench: Command, finished_run: Path, tmp_path: Path) -> None:
    document = json.loads((finished_run / "result.json").read_text(encoding="utf-8"))
    document["parameters"]["gain"]["interval"] = [None, None]
    path = tmp_path / "unknown.json"
    path.write_text(json.dumps(document), encoding="utf-8")

    ended = servobench("stability", path)

    assert ended.status == 3
    assert "don't determine the gain" in " ".join(ended.err.split())
    assert "margin 1" not in ended.out


def test_a_doubtful_motor_is_reported_first(servobench: Command, finished_run: Path, tmp_path: Path) -> None:
    document = json.loads((finished_run / "result.json").read_text(encoding="utf-8"))
    document["verdict"] = "doubtful"
    document["findings"].append(
        {
            "code": "x",
            "severity": "warning",
            "sentence": "The lid was open.",
            "parameters": [],
            "rows": None,
        }
    )
    path = tmp_path / "doubtful.json"
    path.write_text(json.dumps(document), encoding="utf-8")

    said = servobench("stability", path)

    assert said.status == 0
    assert said.out.index("doubtful") < said.out.index("The lid was open.") < said.out.index("To the speed")


def test_only_a_stable_loop_has_margins(servobench: Command, finished_run: Path) -> None:
    backwards = servobench("stability", finished_run, "--kp", "-1")
    assert "The pole at −" in backwards.out
    assert not re.search(r"(?<!\w)-\d", backwards.out)  # one minus sign, and no hyphen for it
    assert "unstable" in backwards.out
    assert "no margins" in backwards.out
    assert "Gain margin" not in backwards.out
    much = " ".join(servobench("stability", finished_run, "--kp", "400").out.split())
    assert "of this gain it would be stable" in much
    assert "Gain margin" not in much
    on_paper = servobench("stability", finished_run, "--continuous").out
    assert "continuous loop" in " ".join(on_paper.split())
    assert "no gain of this sign makes this loop stable" in " ".join(backwards.out.split())


def test_the_gain_that_would_do_is_reported_of_any_that_is_too_much(
    servobench: Command, finished_run: Path
) -> None:
    """The limit is the motor's own, whichever gain it is told as a part of: the gain margin with 1 V/rad."""
    margin = re.search(r"Gain margin ([\d.]+)", servobench("stability", finished_run).out)
    assert margin
    for kp in ("400", "1e4", "1e5", "3.1e5", "1e6", "1e9"):
        said = " ".join(servobench("stability", finished_run, "--kp", kp).out.split())
        part = re.search(
            r"With less than ([\d.]+)(?:×10(⁻\d))? of this gain it would be stable", said.translate(_DIGITS)
        )
        assert part, said
        limit = float(part[1]) * 10 ** int((part[2] or "0").replace("⁻", "-")) * float(kp)
        # Both have four digits, each off by half of the last at most: 5e-4 of the smallest, 1.000.
        assert limit == pytest.approx(float(margin[1]), rel=1.1e-3)


@pytest.mark.parametrize("given", ["0", "-1", "1e-300", "nan", "1e-8"])
def test_a_sample_time_that_cannot_be_is_refused_before_anything_is_said(
    servobench: Command, finished_run: Path, given: str
) -> None:
    """0 was taken as the data's own, -1 was told half-way through the answer, 1e-8 ended in no answer at all."""
    ended = servobench("stability", finished_run, f"--controller-sample-time={given}")

    assert ended.status == 2
    assert ended.out == ""
    assert "--controller-sample-time" in ended.err
    assert "expected" in ended.err


def test_poles_of_what_the_data_leave_open_say_so(servobench: Command, tmp_path: Path) -> None:
    file = tmp_path / "result.json"
    file.write_text(json.dumps(known_together()), encoding="utf-8")

    ended = servobench("stability", file, "--continuous", "--json")

    assert "Not all of the motor is known" in ended.err
    cautions = json.loads(ended.out)["motor"]["cautions"]
    assert any("The time constant isn't known by itself" in each for each in cautions)


@pytest.mark.parametrize(("words", "verdict"), [(("--continuous",), "stable"), ((), "unstable")], ids=str)
def test_over_the_intervals_of_a_recording_a_loop_is_judged_with_ticks_or_without_as_it_is_itself(
    servobench: Command, finished_run: Path, words: tuple[str, ...], verdict: str
) -> None:
    """45 V/rad is too much every 2 ms (37 V/rad), and not without ticks, which stand for a delay of half of that."""
    ended = servobench("stability", finished_run / "recording.mcap", "--kp", "45", *words, "--json")

    found = told(ended.out)
    assert found["loop"]["verdict"] == verdict
    assert [each["verdict"] for each in found["over_intervals"] if each["of"] == "position_loop"] == [verdict]
