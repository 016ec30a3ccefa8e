"""The summary reads a result, or refuses it."""

import json
from pathlib import Path

import pytest

from servobench.core.errors import FormatError, NotIdentifiable, UsageError
from servobench.export.summary import ResultSummary
from tests.export.conftest import GAIN, SD, document


def test_a_file_says_what_the_result_said(tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text(json.dumps(document()), encoding="utf-8")

    for path in (tmp_path, tmp_path / "result.json"):
        answer = ResultSummary.read(path)
        assert answer.estimates["gain"].value == GAIN
        assert answer.covariance[0, 0] == SD["gain"] ** 2
        assert answer.units == ("rad", "V")


def test_a_refused_result_has_no_answer() -> None:
    told = {
        "code": "input-constant",
        "severity": "refusal",
        "sentence": "The input stays at 2 V.",
        "parameters": [],
        "rows": None,
    }

    with pytest.raises(NotIdentifiable, match="The input stays at 2 V"):
        ResultSummary.from_document(document(verdict="refused", findings=[told]), "the result")


@pytest.mark.parametrize(
    "content", ["", "{", "[]", "{}", "[" * 100_000, '{"schema": "servobench.result/3"}', "\x00\x01"]
)
def test_what_is_no_result_is_named(tmp_path: Path, content: str) -> None:
    file = tmp_path / "odd.json"
    file.write_text(content, encoding="utf-8")

    with pytest.raises(FormatError, match=r"odd\.json"):
        ResultSummary.read(file)


def test_a_file_that_isn_t_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"there is no result .*nothing\.json"):
        ResultSummary.read(tmp_path / "nothing.json")


@pytest.mark.parametrize("key", ["parameters", "covariance", "operating_range", "provenance"])
def test_any_part_may_be_missing_or_of_another_kind(key: str) -> None:
    from servobench.export.base import TARGETS, Wishes

    for broken in ({k: v for k, v in document().items() if k != key}, document(**{key: 3})):
        with pytest.raises(FormatError, match="is incomplete"):
            TARGETS["c"]().render(ResultSummary.from_document(broken, "x"), Wishes(sample_time=0.002), "m")
