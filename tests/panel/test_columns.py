"""An imported file whose columns don't say what they are: what is asked, and what becomes of the answers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

import servobench as sb
from servobench.core.errors import ServobenchError
from servobench.panel.columns import mapping_of, questions
from servobench.panel.library import Library, about_in, nearest_name
from servobench.recordings.formats.mapping import assign
from tests.panel.conftest import Served

pytestmark = pytest.mark.usefixtures("pressing_work")

LOGGER = Path(__file__).parents[2] / "examples" / "logger.csv"


def asked(folder: Path, text: str) -> dict[str, Any]:
    (folder / "a.csv").write_text(text)
    return questions(sb.load(folder / "a.csv")[0])


def table(heading: str) -> str:
    return heading + "\n" + "".join(f"{k},{k % 3},{k * k}\n" for k in range(20))


def test_what_is_usual_is_asked_for_where_the_file_itself_does_not_say_it(tmp_path: Path) -> None:
    found = asked(tmp_path, table("t,voltage,angle"))

    assert found["open"]
    assert found["time"] == {"column": "t", "unit": None}  # seconds by convention, or milliseconds
    assert found["input"] == {"column": "voltage", "unit": "V"}
    assert found["output"] == {"column": "angle", "unit": None}
    assert found["columns"][2] == {"name": "angle", "unit": None, "samples": 20, "first": [0, 1, 4, 9, 16]}


@pytest.mark.parametrize("time", ["t [ms]", "t / ms", "t_ms", "millis"])
def test_a_file_that_says_all_of_it_is_not_asked_about(tmp_path: Path, time: str) -> None:
    found = asked(tmp_path, table(f"{time},u [V],theta [deg]"))

    assert not found["open"]
    assert found["time"]["unit"] == "ms"


def test_a_time_that_is_not_recognised_is_asked_for(tmp_path: Path) -> None:
    found = asked(tmp_path, table("ticks,u [V],theta [deg]"))

    assert found["open"]
    assert found["time"] == {"column": None, "unit": None}


def test_a_column_of_text_is_proposed_for_nothing(tmp_path: Path) -> None:
    rows = "".join(f"{k},{k % 3},{k * k},now,go,up\n" for k in range(20))
    found = asked(tmp_path, f"a,pwm,angle,time,command,speed\n{rows}")

    assert [found[role]["column"] for role in ("time", "input", "output")] == [None, "pwm", "angle"]


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"output": "y:deg"}, "the input is missing"),
        ({"input": "u:V", "output": " "}, "the output is missing"),
        ({"input": "u:V", "output": "y"}, "unit of the output"),
        ({"input": "u:V", "output": "y:deg", "time": "t"}, "unit of the time"),
        ({"input": "u:V", "output": "y:deg", "sample_time": "soon"}, "soon"),
        ({"input": "u:V", "output": "y:deg", "sample_time": "-1 s"}, "positive"),
        ({"input": 3}, "text"),
        ({"input": "u" * 501}, "500"),
        ({"recordings": "all"}, "recordings"),
    ],
)
def test_an_answer_that_is_none_is_refused_in_words_of_the_page(given: dict[str, Any], told: str) -> None:
    with pytest.raises(ServobenchError) as error:
        mapping_of(given)

    assert told in str(error.value)
    assert "--" not in str(error.value)  # no options of a command line


def sent(served: Served, name: str, content: bytes) -> httpx.Response:
    headers = served.headers(served.session(), "application/octet-stream")
    return served.http.post("/api/upload", params={"name": name}, headers=headers, content=content)


def test_the_example_is_imported_asked_about_and_identified(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    headers = served.headers(served.session())
    http = served.http
    assert sent(served, "logger.csv", LOGGER.read_bytes()).json() == {
        "name": "logger",
        "open": True,
        "warnings": [],
    }

    def listed() -> dict[str, Any]:
        every = http.get("/api/recordings", headers=headers).json()
        return next(each for each in every if each["name"] == "logger")

    assert (listed()["columns"], listed()["duration"]) == ("open", 0.0)
    early = http.post("/api/recordings/logger/identify", headers=headers, json={})
    assert early.status_code == 409
    assert "columns" in early.json()["error"]
    form = http.get("/api/recordings/logger/columns", headers=headers).json()
    assert (form["open"], form["said"]) == (True, {})

    wrong = {"time": "time:s", "input": "voltage:V", "output": "angle:A"}
    assert http.post("/api/recordings/logger/columns", headers=headers, json=wrong).status_code == 400
    right = {"time": "time:s", "input": "voltage:V", "output": "angle:deg", "chain": "none"}
    assert http.post("/api/recordings/logger/columns", headers=headers, json=right).status_code == 200

    assert listed()["columns"] == "said"
    assert listed()["duration"] == pytest.approx(999 * 0.005)  # its 1000 samples are 5 ms apart
    form = http.get("/api/recordings/logger/columns", headers=headers).json()
    assert form["said"] == right
    frame = http.get("/api/recordings/logger/rows", headers=headers).content
    t = np.frombuffer(frame, "<f8", 1000, 24)
    np.testing.assert_allclose(t, 0.005 * np.arange(1000), atol=1e-9)
    early = http.get("/api/recordings/logger/result", headers=headers)
    assert (early.status_code, early.json()["error"]) == (
        404,
        "logger isn't identified yet: identify it first",
    )
    kept = []  # the verdict that is kept when somebody is told that the identification is over
    tell = served.panel.motor.tell

    def listening(message: Mapping[str, Any]) -> None:
        if message.get("over"):
            kept.append(about_in(served.panel.library.folder_of("logger")).verdict)
        tell(message)

    monkeypatch.setattr(served.panel.motor, "tell", listening)
    answer = http.post("/api/recordings/logger/identify", headers=headers, json={}, timeout=300).json()
    assert kept == [answer["verdict"]]
    # The same as the command says of the same file.
    recording = assign(sb.load(LOGGER)[0], time="time:s", input="voltage:V", output="angle:deg", chain="none")
    told = sb.identify([sb.measure(recording)]).to_dict()
    assert answer["verdict"] == told["verdict"]
    for name, parameter in told["parameters"].items():
        assert answer["parameters"][name]["value"] == pytest.approx(parameter["value"], rel=1e-6)
    # It can be had again, until somebody says that the columns are others.
    assert http.get("/api/recordings/logger/result", headers=headers).json() == answer
    http.post("/api/recordings/logger/columns", headers=headers, json=right)
    assert http.get("/api/recordings/logger/result", headers=headers).status_code == 404


def test_times_in_milliseconds_are_what_the_answer_says(served: Served) -> None:
    headers = served.headers(served.session())
    assert sent(served, "ms.csv", table("t,u [V],theta [deg]").encode()).json()["open"]

    said = {"time": "t:ms", "input": "u:V", "output": "theta:deg"}
    served.http.post("/api/recordings/ms/columns", headers=headers, json=said)

    (listed,) = [
        each for each in served.http.get("/api/recordings", headers=headers).json() if each["name"] == "ms"
    ]
    assert listed["duration"] == pytest.approx(0.019)  # 20 samples 1 ms apart


def test_a_second_file_of_a_name_gets_a_number_and_an_odd_name_is_made_to_fit(served: Served) -> None:
    content = table("t [s],u [V],theta [deg]").encode()
    names = [
        sent(served, name, content).json()["name"]
        for name in ("Übung 日本.csv", "Übung 日本.csv", "first run.csv")
    ]

    assert names == ["Ubung", "Ubung-2", "first-run"]
    assert sent(served, "no-ending", content).status_code == 400


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("logger", "logger"),
        ("first run", "first-run"),
        ("../../etc/passwd", "etc-passwd"),
        (".hidden", "hidden"),
        ("日本", "import"),
        ("con", "import-con"),
        ("a" * 300, "a" * 56),
        ("é" * 3 + ".", "eee"),
    ],
)
def test_a_name_is_made_to_fit(text: str, name: str) -> None:
    assert nearest_name(text) == name


def test_a_deleted_recording_keeps_its_name(tmp_path: Path) -> None:
    library = Library(tmp_path)
    library.prepare()
    library.new_like("a")
    library.delete("a")

    assert library.new_like("A").name == "A-2"
    assert library.new_like("a").name == "a-3"
