"""Names lead nowhere but into the folder of recordings, and what is deleted can be brought back."""

from __future__ import annotations

import json
import os
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest

import servobench as sb
from servobench.core.errors import FormatError, UnknownName, UsageError
from servobench.panel.library import ABOUT, About, Library, about_in, check_name, keep_about
from tests.panel.conftest import Served

pytestmark = pytest.mark.usefixtures("pressing_work")

ODD = (
    "", ".", "..", "...", ".hidden", "-a", "_a", "a/b", "a\\b", "/etc/passwd", "../x", "..\\..\\w", "a/../../b", "C:\\x", "C:x",
    "con", "CON", "nul.txt", "aux", "com1", "LPT9.mcap", "a.", "a\0b", "a\nb", "a b", "a\u202eb", "\u0430bc", "ａ", "a" * 65,
    "a" * 300, "%2e%2e", "..%2f", "~", "$HOME", "a:b", "a*", "a?b", "a|b", "<a>", '"a"', "a\ud800", "\ufeffa", "é",
)  # fmt: skip
GOOD = ("a", "Run-1", "run-20260101-120000", "a..b", "0", "A" * 64, "con1", "console", "x.csv")


def fits(name: str) -> bool:
    try:
        check_name(name)
    except UsageError:
        return False
    return True


def names(count: int) -> list[str]:
    """Names put together from what attacks are made of, and from what is harmless."""
    rng = np.random.default_rng(24)
    parts = [*ODD, *GOOD, "/", "\\", "..", "../", "\0", "%", "."]
    return ["".join(rng.choice(parts, size=rng.integers(1, 5))) for _ in range(count)]


def inside(folder: Path, name: str) -> bool:
    """Whether a name, put behind a folder, is one entry of it on any system."""
    path = folder / name
    return (
        path.parent == folder
        and path.name == name
        and os.path.normpath(path) == str(path)
        and "\\" not in name
    )


@pytest.mark.parametrize("name", [*ODD, None, 3, ["a"], {"a": 1}, b"a"])
def test_an_odd_name_is_refused(name: object) -> None:
    with pytest.raises(UsageError, match="can't be the name"):
        check_name(name)


@pytest.mark.parametrize("name", GOOD)
def test_a_usual_name_is_taken(name: str) -> None:
    assert check_name(name) == name


def test_of_ten_thousand_names_none_leads_out_of_the_folder(tmp_path: Path) -> None:
    taken = 0
    for name in names(10_000):
        try:
            found = check_name(name)
        except UsageError:
            continue
        taken += 1
        assert inside(tmp_path, found)
        assert found.isascii()

    assert 100 < taken < 9_000  # both kinds were among them


@pytest.mark.parametrize("more", [15, pytest.param(150, marks=pytest.mark.long)])
def test_names_lead_nowhere_over_the_network_either(served: Served, folder: Path, more: int) -> None:
    secret = folder.parent / "secret"
    secret.mkdir(exist_ok=True)
    (secret / "recording.mcap").write_bytes(b"secret")
    before = sorted(path for path in folder.parent.rglob("*"))
    session = served.session()
    headers = served.headers(session)
    upload = served.headers(session, "application/octet-stream")
    # What a client makes of a path before it asks is left out: the name goes out as it is.
    line = HTTPConnection("127.0.0.1", served.port, timeout=30)

    def asked(method: str, path: str, headers: dict[str, str], body: bytes | None = None) -> int:
        line.request(method, path, body=body, headers=headers)
        answer = line.getresponse()
        answer.read()
        if answer.will_close:
            line.close()
        return answer.status

    for name in [*ODD, *(each for each in names(more) if not fits(each))]:
        told = quote(name.encode("utf-8", "surrogatepass"), safe="").replace(".", "%2e")
        for way in ("download", "rows", "download?as=csv", "result"):
            assert asked("GET", f"/api/recordings/{told}/{way}", headers) in (400, 404), name
        assert asked("GET", f"/reports/{told}", headers) in (400, 404), name
        assert asked("GET", f"/static/{told}", headers) == 404, name
        assert asked("GET", f"/uplot/{told}", headers) == 404, name
        for way in ("notes", "delete", "undelete", "identify"):
            assert asked("POST", f"/api/recordings/{told}/{way}", headers, b'{"notes":"x"}') in (400, 404), (
                name
            )
        assert asked("POST", f"/api/upload?name={told}", upload, b"no recording") == 400, name
    line.close()

    assert sorted(path for path in folder.parent.rglob("*")) == before


def a_recording(library: Library, name: str, notes: str = "") -> Path:
    folder = library.new(name)
    (folder / "recording.mcap").write_bytes(b"x")
    keep_about(folder, About(created=f"2026-01-01T00:00:0{len(library.list())}", notes=notes))
    return folder


def test_what_is_deleted_is_moved_and_can_be_brought_back(tmp_path: Path) -> None:
    library = Library(tmp_path)
    library.prepare()
    a_recording(library, "a", "first")
    a_recording(library, "b")

    library.delete("a")

    assert [(each["name"], each["deleted"]) for each in library.list()] == [("b", False), ("a", True)]
    with pytest.raises(UnknownName):
        library.file("a", "recording.mcap")
    with pytest.raises(UsageError, match="already"):
        library.new("A")  # which is the same on some systems
    library.undelete("a")
    assert about_in(library.folder_of("a")).notes == "first"
    with pytest.raises(UnknownName):
        library.undelete("a")


def test_links_are_no_recordings_and_no_files_of_one(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "recording.mcap").write_bytes(b"x")
    (tmp_path / "secret").write_text("x")
    library = Library(tmp_path / "library")
    library.prepare()
    folder = a_recording(library, "a")
    try:
        (library.folder / "linked").symlink_to(elsewhere, target_is_directory=True)
        (folder / "report.html").symlink_to(tmp_path / "secret")
        os.replace(folder / "about.json", tmp_path / "about.json")
        (folder / "about.json").symlink_to(tmp_path / "about.json")
    except OSError:  # where one may not make links, there are none
        pytest.skip("this system doesn't let us make symbolic links")

    assert [each["name"] for each in library.list()] == ["a"]
    assert about_in(folder) == About()
    with pytest.raises(UnknownName):
        library.folder_of("linked")
    with pytest.raises(UnknownName):
        library.file("a", "report.html")
    library.note("a", "mine")
    assert (
        json.loads((tmp_path / "about.json").read_text())["notes"] == ""
    )  # what the link leads to isn't touched


@pytest.mark.parametrize(
    "text", ["", "[]", "{", '{"created": null}', '{"duration": "long"}', "[" * 100_000, "\ud800"]
)
def test_a_spoilt_note_spoils_no_list(tmp_path: Path, text: str) -> None:
    library = Library(tmp_path)
    library.prepare()
    folder = a_recording(library, "a")
    (folder / "about.json").write_text(text, encoding="utf-8", errors="surrogatepass")

    assert [each["name"] for each in library.list()] == ["a"]


@pytest.mark.parametrize("text", ["", "[]", "{", "[" * 100_000, "\ud800"])
def test_a_spoilt_result_says_what_to_do(tmp_path: Path, text: str) -> None:
    library = Library(tmp_path)
    library.prepare()
    folder = a_recording(library, "a")
    assert library.result("a") is None
    library.judge(folder, {"verdict": "trusted"})
    assert library.result("a") == {"verdict": "trusted"}
    (folder / "result.json").write_text(text, encoding="utf-8", errors="surrogatepass")

    with pytest.raises(FormatError, match="identify a again"):
        library.result("a")


@pytest.mark.parametrize("notes", [None, 3, "x" * 10_001, ["a"]])
def test_notes_are_a_text_of_some_length(tmp_path: Path, notes: object) -> None:
    library = Library(tmp_path)
    library.prepare()
    a_recording(library, "a")

    with pytest.raises(UsageError, match="notes"):
        library.note("a", notes)


def test_recordings_of_one_second_have_names_of_their_own(tmp_path: Path) -> None:
    library = Library(tmp_path)
    library.prepare()

    assert len({library.new().name for _ in range(5)}) == 5


def test_what_is_lost_of_a_damaged_file_is_said_at_import_and_kept(served: Served, tmp_path: Path) -> None:
    """Flipped in its middle or cut off: what came before is imported, and nobody takes it for all there was."""
    with sb.connect("twin") as motor:
        made = sb.run(sb.Experiment(duration=10), motor)
    sb.save(made, tmp_path / "whole.mcap")
    whole = (tmp_path / "whole.mcap").read_bytes()
    late = (
        len(whole) * 85 // 100
    )  # among the samples of the second chunk: after each chunk come places of messages
    flipped = whole[:late] + bytes(255 - each for each in whole[late : late + 64]) + whole[late + 64 :]
    session = served.session()
    upload = served.headers(session, "application/octet-stream")

    for name, content in (("flipped", flipped), ("cut", whole[: len(whole) // 2])):
        (tmp_path / f"{name}.mcap").write_bytes(content)
        (read,) = sb.load(tmp_path / f"{name}.mcap")
        (lost,) = (each.sentence for each in read.findings if each.code == "recording-cut-short")
        answer = served.http.post(f"/api/upload?name={name}.mcap", headers=upload, content=content).json()
        assert answer == {"name": name, "open": False, "warnings": [lost]}
        listed = served.http.get("/api/recordings", headers=served.headers(session)).json()
        (entry,) = [each for each in listed if each["name"] == name]
        assert entry["warnings"] == [lost]
        assert entry["duration"] < 9


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("Übung 日本.mcap", b"no recording"),
        ("my run.csv", b"t [s],u [V]\n"),
        ("empty.mat", b"MATLAB 5.0 MAT-file" + bytes(200)),
        ("torn.mcap", b"\x89MCAP0\r\n\x01"),
        ("A.LOG.Parquet", b"PAR1 and no more"),
    ],
)
def test_a_file_that_cannot_be_imported_is_called_as_its_owner_calls_it(
    served: Served, name: str, content: bytes
) -> None:
    upload = served.headers(served.session(), "application/octet-stream")
    answer = served.http.post("/api/upload", params={"name": name}, headers=upload, content=content)

    assert answer.status_code == 400
    told = answer.json()["error"]
    assert name in told
    assert "upload" not in told
    assert str(served.panel.library.folder) not in told
    assert "/." not in told


@pytest.mark.parametrize("spoilt", ['"a sentence"', "[1, 2]", "7"])
def test_warnings_that_somebody_has_spoilt_are_none(tmp_path: Path, spoilt: str) -> None:
    (tmp_path / ABOUT).write_text(f'{{"notes": "mine", "warnings": {spoilt}}}')

    assert about_in(tmp_path) == About(notes="(about.json can't be read)")


def test_warnings_of_a_recording_outlast_the_panel(tmp_path: Path) -> None:
    keep_about(tmp_path, About(warnings=("the end is missing",)))

    assert about_in(tmp_path).warnings == ("the end is missing",)


def test_a_recording_is_uploaded_noted_deleted_and_downloaded(served: Served, tmp_path: Path) -> None:
    with sb.connect("twin") as motor:
        made = sb.run(sb.Experiment(duration=1), motor)
    sb.save(made, tmp_path / "mine.csv")
    session = served.session()
    headers = served.headers(session)
    upload = {**headers, "content-type": "application/octet-stream"}
    http = served.http

    answer = http.post(
        "/api/upload?name=mine.csv", headers=upload, content=(tmp_path / "mine.csv").read_bytes()
    )

    assert answer.json() == {"name": "mine", "open": False, "warnings": []}
    assert (
        http.post("/api/recordings/mine/notes", headers=headers, json={"notes": "Übung 1"}).status_code == 200
    )
    (listed,) = [
        each for each in http.get("/api/recordings", headers=headers).json() if each["name"] == "mine"
    ]
    assert listed["samples"] == 500
    assert listed["notes"] == "Übung 1"
    frame = http.get("/api/recordings/mine/rows", headers=headers).content
    assert frame[:4] == b"SVB1"
    native = http.get("/api/recordings/mine/download", headers=headers)
    (tmp_path / "back.mcap").write_bytes(native.content)
    (back,) = sb.load(tmp_path / "back.mcap")
    np.testing.assert_array_equal(back["counts"].values, made["counts"].values)
    text = http.get("/api/recordings/mine/download?as=csv", headers=headers)
    assert text.headers["content-disposition"] == 'attachment; filename="mine.csv"'
    (tmp_path / "again.csv").write_bytes(text.content)
    np.testing.assert_array_equal(sb.load(tmp_path / "again.csv")[0]["counts"].values, made["counts"].values)
    assert http.post("/api/recordings/mine/delete", headers=headers, json={}).status_code == 200
    assert http.get("/api/recordings/mine/rows", headers=headers).status_code == 404
    assert http.post("/api/recordings/mine/undelete", headers=headers, json={}).status_code == 200
    assert http.post("/api/upload?name=mine.csv", headers=upload, content=b"x").status_code == 400


def test_a_file_that_cannot_be_read_is_reported_by_the_recordings_name(served: Served, folder: Path) -> None:
    session = served.session()
    headers = served.headers(session)
    a_recording(served.panel.library, "junk")

    for method, way, status in (
        ("GET", "rows", 422),
        ("GET", "download?as=csv", 400),
        ("POST", "identify", 400),
    ):
        body = {"json": {}} if method == "POST" else {}
        answer = served.http.request(method, f"/api/recordings/junk/{way}", headers=headers, **body)
        assert answer.status_code == status, way
        assert answer.json()["error"].startswith("junk isn't "), way
        assert str(folder) not in answer.text, way


def test_a_path_in_a_sentence_becomes_the_recordings_name(tmp_path: Path) -> None:
    library = Library(tmp_path / "a+b")
    inside = library.folder

    assert library.with_names(f"{inside}/run.1/recording.mcap is torn") == "run.1 is torn"
    assert (
        library.with_names(f"{inside}/run/result.json, {inside}/run/about.json")
        == "run/result.json, run/about.json"
    )
    assert (
        library.with_names(f"give another --folder than {inside}") == f"give another --folder than {inside}"
    )
