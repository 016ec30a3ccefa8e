"""The page of an inspection: whole, harmless, and saying what there is to be said."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from servobench.core.channels import Channel
from servobench.core.errors import StorageError
from servobench.core.rounding import with_unit
from servobench.recordings.recording import Recording, Series, Source
from servobench.report.inspection import InspectionReport
from tests.report.conftest import HOSTILE
from tests.report.test_page import Page


def recording(**units: str | None) -> Recording:
    random = np.random.default_rng(6)
    t = np.cumsum(random.uniform(0.009, 0.011, 400))
    t[250:] += 0.2
    u = np.clip(12.0 * np.sin(2 * t), -10.0, 10.0)
    values = (u, np.round(np.cumsum(u) * 0.01, 2))
    series = tuple(
        Series(channel=Channel(name=name, unit=unit), values=x, t=t)
        for (name, unit), x in zip(units.items(), values, strict=True)
    )
    return Recording(
        name="drive", series=series, source=Source(name="drive.csv", sha256="ab12", format="csv")
    )


def test_the_page_is_whole_needs_no_network_and_runs_nothing() -> None:
    text = InspectionReport([recording(u="V", theta="rad")]).html()

    page = Page(text)
    assert not {"script", "iframe", "object"} & {tag for tag, _ in page.elements}
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert not re.search(r"(?:src|href)=\\?\"https?:", text)
    assert text == InspectionReport([recording(u="V", theta="rad")]).html()


def test_times_limits_levels_and_support_are_on_it() -> None:
    text = InspectionReport([recording(u="V", theta="rad")]).html()

    assert "Ready" in text
    assert "It can be identified as it is: the output is a position in rad" in text
    assert "it is limited" in text
    assert "Intervals between samples" in text
    assert re.search(r"1 gap beyond", text)
    assert ">0.01<" in text.replace("\u2009", "")  # the quantum of theta


def test_what_has_to_be_said_is_on_it() -> None:
    text = InspectionReport([recording(a=None, b=None)]).html()

    assert "Questions" in text
    assert "<code>input=COL:UNIT</code>" in text


def test_an_input_that_never_changes_is_not_called_ready() -> None:
    one = recording(u="V", theta="rad")
    constant = replace(one.series[0], values=np.full(400, 2.0))

    text = InspectionReport([replace(one, series=(constant, one.series[1]))]).html()

    assert "Not as it is" in text
    assert "input-constant" in text


def test_several_recordings_stand_below_each_other_and_names_from_files_are_harmless() -> None:
    one = recording(u="V", theta="rad")
    several = [replace(one, name=HOSTILE), replace(one, name="second")]

    page = Page(InspectionReport(several).html())

    assert not {"script", "img"} & {tag for tag, _ in page.elements}
    assert sum(tag == "section" for tag, _ in page.elements) == 3


def test_a_recording_without_times_or_values_has_a_page() -> None:
    empty = Series(channel=Channel(name="y", unit="rad"), values=np.full(3, np.nan), t=None)
    none = Recording(name="none", series=(empty,), source=Source(name="none.csv"))

    Page(InspectionReport([none]).html())


def test_it_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    report = InspectionReport([recording(u="V", theta="rad")])

    report.write(tmp_path / "page.html")

    assert (tmp_path / "page.html").read_text(encoding="utf-8") == report.html()
    with pytest.raises(StorageError, match="there is no folder"):
        report.write(tmp_path / "nowhere" / "page.html")


def test_each_time_base_is_named_after_the_channels_that_have_it() -> None:
    one = recording(u="V", theta="rad")
    t = one.series[1].t
    assert t is not None
    later = replace(one.series[1], t=t + 0.3)

    text = InspectionReport([replace(one, series=(one.series[0], later))]).html()

    starts = dict(re.findall(r'<th scope="row">(u|theta)</th><td class="number">([\d.]+\xa0m?s)</td>', text))
    assert starts == {"u": with_unit(t[0], "s", 4), "theta": with_unit(t[0] + 0.3, "s", 4)}
