"""A body that is too large, too deep or endless is refused while it arrives, and the loop isn't disturbed."""

from __future__ import annotations

import io
import socket
import tracemalloc
import zipfile
from collections.abc import Iterator

import pytest

from servobench.panel.bodies import LARGEST_JSON, LARGEST_UPLOAD, parse_object
from servobench.panel.gate import Refused
from servobench.panel.routes import TABLE
from tests.panel.conftest import Served, wait_for
from tests.panel.test_gate import path_of

SAYING = [way for way in TABLE if way.asks.body == "application/json"]
MOST_MEMORY = 64 * 1024 * 1024


def status_of_endless(served: Served, path: str, content: str, piece: bytes, most: int) -> tuple[int, int]:
    """Send a body without an end; return the status that is answered, and how many bytes were sent until then."""
    headers = {**served.headers(served.session(), content), "host": f"127.0.0.1:{served.port}"}
    head = "".join(f"{name}: {value}\r\n" for name, value in headers.items())
    sent = 0
    with socket.create_connection(("127.0.0.1", served.port), timeout=30) as line:
        line.sendall(f"POST {path} HTTP/1.1\r\n{head}transfer-encoding: chunked\r\n\r\n".encode())
        try:
            while sent < most:
                line.sendall(b"%x\r\n%s\r\n" % (len(piece), piece))
                sent += len(piece)
        except (BrokenPipeError, ConnectionResetError):
            pass
        try:
            answer = line.recv(4096)
        except ConnectionResetError:  # more was on its way than the answer waited for
            return 0, sent
    return int(answer.split(b" ")[1]), sent


def test_a_json_body_that_is_too_large_is_refused_on_every_route(served: Served) -> None:
    large = b'{"notes": "' + b"x" * LARGEST_JSON + b'"}'
    for way in SAYING:
        headers = served.headers(served.session())
        path = path_of(way)
        assert served.http.post(path, headers=headers, content=large).status_code == 413, path


@pytest.mark.parametrize("length", ["99999999999", "1e9", "-1", "9" * 5000])
def test_a_body_that_says_that_it_is_too_large_is_not_waited_for(served: Served, length: str) -> None:
    headers = {
        **served.headers(served.session()),
        "host": f"127.0.0.1:{served.port}",
        "content-length": length,
    }
    head = "".join(f"{name}: {value}\r\n" for name, value in headers.items())
    with socket.create_connection(("127.0.0.1", served.port), timeout=30) as line:
        line.sendall(f"POST /api/preview HTTP/1.1\r\n{head}\r\n".encode())
        status = int(line.recv(4096).split(b" ")[1])

    assert status in (400, 413)


@pytest.mark.parametrize(
    "text",
    [
        b"[" * 60_000,
        b'{"a":' * 10_000,
        b'{"signal":' * 5_000 + b"1" + b"}" * 5_000,
        b'{"signal":' * 400 + b"1" + b"}" * 400,
        b'{"a": NaN}',
        b'{"a": 1e999}',
        b'{"a": -Infinity}',
        b'{"a": ' + b"9" * 5000 + b"}",
        b'{"a": "\\ud800"}',
        b"\xff\xfe",
        b"\x00",
        b"",
        b"null",
        b"[1]",
        b'"text"',
    ],
    ids=range(15),
)
def test_json_that_is_none_or_too_deep_is_refused_on_every_route(served: Served, text: bytes) -> None:
    for way in SAYING:
        if way.path == "/api/stop" and text.startswith(b'{"signal":' * 400 + b"1"):
            continue  # STOP looks at nothing that comes along
        path = path_of(way)
        answer = served.http.post(path, headers=served.headers(served.session()), content=text)
        assert answer.status_code in (400, 404), path
        assert answer.json()["error"]


def test_a_body_without_an_end_is_cut_off(served: Served) -> None:
    # What is beyond the limit is forgotten as it comes, up to as much again as an upload may have.
    status, sent = status_of_endless(
        served, "/api/preview", "application/json", b"x" * 100_000, 2 * LARGEST_UPLOAD
    )
    assert status in (413, 0)
    assert sent < LARGEST_UPLOAD + 20_000_000  # and what the system's buffers took

    status, sent = status_of_endless(
        served, "/api/upload?name=a.csv", "application/octet-stream", b"1,2\n" * 16_384, 3 * LARGEST_UPLOAD
    )
    assert status in (413, 0)
    assert sent < 2 * LARGEST_UPLOAD + 20_000_000
    assert not (served.panel.library.folder / "a").exists()


def test_an_upload_that_is_too_large_leaves_nothing_and_takes_no_memory(served: Served) -> None:
    headers = served.headers(served.session(), "application/octet-stream")
    served.http.get("/api/catalogue", headers=headers)  # what is made once isn't counted
    piece = b"0.001,2.0,3.0\n" * 4096

    def pieces() -> Iterator[bytes]:
        for _ in range(2 + LARGEST_UPLOAD // len(piece)):
            yield piece

    tracemalloc.start()
    try:
        answer = served.http.post("/api/upload?name=big.csv", headers=headers, content=pieces())
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()

    assert answer.status_code == 413
    assert most < MOST_MEMORY / 4  # the client's is in it, too
    assert not (served.panel.library.folder / "big").exists()


def bombs() -> dict[str, bytes]:
    """Small files that become large ones, or that look deep."""
    zeros = bytes(1 << 20)
    npz = io.BytesIO()
    with zipfile.ZipFile(npz, "w", zipfile.ZIP_DEFLATED) as packed, packed.open("u.npy", "w") as out:
        out.write(b"\x93NUMPY\x01\x00v\x00")
        header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (33554432,), }"
        out.write(header.ljust(117) + b"\n")
        for _ in range(256):
            out.write(zeros)
    return {
        "bomb.npz": npz.getvalue(),
        "deep.json": b"[" * 500_000,
        "wide.csv": b"," * 3_000_000,
    }


@pytest.mark.parametrize("name", ["bomb.npz", "deep.json", "wide.csv"])
def test_a_bomb_is_refused_and_the_loop_does_not_notice(served: Served, name: str) -> None:
    headers = served.headers(served.session(), "application/octet-stream")
    signs = served.loop.signs

    answer = served.http.post(f"/api/upload?name={name}", headers=headers, content=bombs()[name])

    assert answer.status_code in (400, 413), answer.text
    assert answer.json()["error"]
    assert [path.name for path in served.panel.library.folder.iterdir()] == [".trash"]
    wait_for(lambda: served.loop.signs > signs)  # signs of life went on


def test_numbers_are_finite_and_texts_are_texts() -> None:
    assert parse_object('{"a": 1.5, "b": "ü"}') == {"a": 1.5, "b": "ü"}
    with pytest.raises(Refused, match="too large"):
        parse_object('{"a": 1e400}')
