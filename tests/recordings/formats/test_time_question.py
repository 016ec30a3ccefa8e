"""The question about times, and the figure that it proposes."""

from pathlib import Path

import pytest

from servobench.core.errors import MissingInformation
from servobench.recordings.formats.mapping import assign
from servobench.recordings.formats.proposal import proposal
from servobench.recordings.recording import Recording
from tests.recordings.formats.tables import codes, finding, loaded


def log(folder: Path, header: str, times: list[str]) -> Recording:
    rows = (f"{time},{k % 7},{3 * k}\n" for k, time in enumerate(times))
    return loaded(folder, f"{header},u [V],angle [deg]\n" + "".join(rows))


def question(recording: Recording) -> str:
    with pytest.raises(MissingInformation) as caught:
        assign(recording)
    return caught.value.missing[-1]


TWO_DECIMALS = [f"{0.005 * k:.2f}" for k in range(600)]
MILLISECONDS = [str(k // 2) for k in range(600)]
TIMES_OF_DAY = [f"12:34:{5 + k // 10:02d}" for k in range(6, 400)]


@pytest.mark.parametrize(
    ("header", "times", "step"),
    [("Time(s)", TWO_DECIMALS, "0.005"), ("t_ms", MILLISECONDS, "0.0005"), ("Time", TIMES_OF_DAY, "0.1")],
)
def test_times_too_coarse_to_be_used_give_the_sample_time(
    header: str, times: list[str], step: str, tmp_path: Path
) -> None:
    recording = log(tmp_path, header, times)

    assert f"say `sample_time={step}` (in s)" in question(recording)
    assert f'# sample_time = "{step} s"' in proposal([recording])
    assert "sample-time-contradicts" not in codes(assign(recording, sample_time=float(step)).findings)
    doubt = finding(assign(recording, sample_time=4 * float(step)).findings, "sample-time-contradicts")
    assert f"If the column is right, say `sample_time={step}`" in doubt.sentence


def test_a_few_whole_seconds_give_no_figure_but_a_range(tmp_path: Path) -> None:
    asked = question(log(tmp_path, "Time", TIMES_OF_DAY[:50]))

    assert "its mean step is 0.08163 to 0.1224 s" in asked  # 5 s and 1 s in 49 steps
    assert "`sample_time=SECONDS`" in asked


def test_repeated_rows_are_left_out_and_do_not_halve_the_sample_time(tmp_path: Path) -> None:
    rows = "".join(2 * f"{0.01 * k:.2f},{k % 7},{3 * k}\n" for k in range(100))
    recording = loaded(tmp_path, "t [s],u [V],angle [deg]\n" + rows)

    assert "rows with the same `t` are repeated: say `time=t:s`" in question(recording)
    doubt = finding(assign(recording, sample_time=0.01).findings, "sample-time-contradicts")
    assert "Say `time=t:s` instead" in doubt.sentence


def test_no_figure_is_proposed_where_none_is_known(tmp_path: Path) -> None:
    recording = log(tmp_path, "other [A]", ["1.5"] * 40)

    assert "`sample_time=SECONDS`" in question(recording)
    assert '# sample_time = "SECONDS"' in proposal([recording])


def test_a_time_stamp_in_another_form_is_told_the_forms_that_are_read(tmp_path: Path) -> None:
    asked = question(log(tmp_path, "Time", [f"12:34:56:{k:03d}" for k in range(60)]))

    assert (
        "such as '12:34:56:000', and no number; time stamps are read in the form of '12:34:56.789'" in asked
    )


def test_dates_are_asked_for_in_their_unit(tmp_path: Path) -> None:
    asked = question(log(tmp_path, "timestamp", [str(1709642096000 + 10 * k) for k in range(60)]))

    assert "say `time=timestamp:ms`, or what the unit is; otherwise" in asked


def test_nanoseconds_are_recognised_by_the_ending_of_a_name(tmp_path: Path) -> None:
    assigned = assign(log(tmp_path, "time_ns", [str(10_000_000 * k) for k in range(60)]))

    assert assigned["u"].t is not None
    assert assigned["u"].t[59] == pytest.approx(0.59)


def test_two_times_with_units_of_their_own_are_asked_for_in_those(tmp_path: Path) -> None:
    rows = (f"{20 * k},{0.02 * k:.3f},{k % 7},{3 * k}\n" for k in range(60))
    recording = loaded(tmp_path, "t_ms,t_sec,u [V],angle [deg]\n" + "".join(rows))

    assert question(recording).endswith(
        "say `time=t_ms:ms` or `time=t_sec:s`; otherwise `sample_time=SECONDS`"
    )
