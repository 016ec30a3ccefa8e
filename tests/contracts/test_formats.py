"""Every file format, including those of plug-ins."""

import tempfile
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from servobench.core.channels import Channel
from servobench.core.errors import FormatError, StorageError, UsageError
from servobench.recordings.formats.base import FORMATS, Format, save
from servobench.recordings.loading.load import load
from servobench.recordings.recording import Recording, Series, Source
from tests.files import refill
from tests.recordings.formats.makers import make
from tests.recordings.native.samples import recordings, small

NAMES = FORMATS.names()
MUTATIONS = 200
# Reading takes some copies of a file and libraries have buffers; a length that a flipped bit has made huge would take far more.
MOST_MEMORY = 64e6  # bytes

RANDOM = np.random.default_rng(11)
T = np.cumsum(RANDOM.uniform(0.001, 0.003, 500))


def series(name: str, unit: str | None, values: np.ndarray, t: np.ndarray | None) -> Series:
    return Series(channel=Channel(name=name, unit=unit), values=values, t=t)


def recording(name: str, *all_series: Series) -> Recording:
    return Recording(name=name, series=all_series, source=Source(name="made up"))


RECORDINGS = [
    small(),
    small("no samples", samples=0),
    recording("nothing"),
    recording("one number", series("y", None, np.array([0.1 + 0.2]), None)),
    recording(
        "µ, ω and 漢字",
        series("ω [rad/s]", "rad/s", RANDOM.normal(size=500), T),
        series("comma, quote \" and\nline", "V", np.sign(RANDOM.normal(size=500)), T),
        series("# no comment", "°", np.full(500, np.nan), T),
    ),
    recording(
        "rates",
        series("u", "V", RANDOM.normal(size=500), T),
        series("y", "rad", RANDOM.normal(size=50), T[::10] + 1e-9),
        series("i", "A", np.array([np.inf, -np.inf, np.nan, 5e-324, -0.0, 1.7976931348623157e308]), None),
    ),
]  # fmt: skip


def written(name: str, several: tuple[Recording, ...], folder: Path) -> Path | None:
    """Write recordings in a format; None where it refuses them, which has to name the file and to leave none."""
    path = folder / f"a{FORMATS[name].suffixes[0]}"
    if next(each for each in NAMES if path.suffix in FORMATS[each].suffixes) != name:
        return None  # it's only read; another format writes files that end so
    try:
        save(several, path)
    except UsageError as error:
        refusal = str(error)
    else:
        return path
    assert refusal.startswith(path.name)
    assert list(folder.iterdir()) == []
    return None


@pytest.mark.parametrize("name", NAMES)
def test_a_format_is_known_by_its_name_and_its_endings(name: str) -> None:
    assert isinstance(FORMATS[name](), Format)
    assert FORMATS.name_of(FORMATS[name]()) == name
    assert FORMATS[name].suffixes
    assert all(suffix.startswith(".") and suffix == suffix.lower() for suffix in FORMATS[name].suffixes)


@pytest.mark.parametrize("name", NAMES)
def test_a_format_says_whether_it_is_written(name: str, tmp_path: Path) -> None:
    form = FORMATS[name]
    assert set(form.written) <= set(form.suffixes)
    try:
        form().write((small(),), tmp_path / f"a{form.suffixes[0]}")
    except UsageError:
        assert form.written == (), "a written format holds any recording; one that doesn't has `written = ()`"
    else:
        assert form.suffixes[0] in form.written


def test_no_two_formats_that_are_written_have_the_same_ending() -> None:
    """Those that are only read may: which one a file is, its content says."""
    endings = [ending for name in NAMES for ending in FORMATS[name].written]

    assert len(endings) > 3
    assert len(set(endings)) == len(endings)


@pytest.mark.parametrize("original", RECORDINGS, ids=lambda each: each.name)
@pytest.mark.parametrize("name", NAMES)
def test_what_is_written_comes_back_equal_or_is_refused(
    name: str, original: Recording, tmp_path: Path
) -> None:
    path = written(name, (original,), tmp_path)
    if path is None:
        return

    (back,) = load(path)

    assert replace(back, source=original.source) == original
    assert back.source.name == str(path)
    assert back.source.format == name
    assert len(back.source.sha256) == 64


@pytest.mark.parametrize("name", NAMES)
def test_several_recordings_come_back_equal_or_are_refused(name: str, tmp_path: Path) -> None:
    originals = (small("a"), small("b", samples=4), small("b", samples=0))
    path = written(name, originals, tmp_path)
    if path is None:
        return

    back = load(path)

    assert tuple(replace(each, source=originals[0].source) for each in back) == originals


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=100, suppress_health_check=[HealthCheck.too_slow])
@given(original=recordings())
def test_any_recording_comes_back_equal_or_is_refused(name: str, original: Recording) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = written(name, (original,), Path(folder))
        if path is None:
            return

        (back,) = load(path)

    assert replace(back, source=original.source) == original


@pytest.mark.parametrize("name", NAMES)
def test_a_format_recognises_its_own_files_and_not_those_of_others(name: str, tmp_path: Path) -> None:
    path = written(name, (small(samples=300),), tmp_path) or make(name, tmp_path)
    head = path.read_bytes()[:4096]

    recognising = [each for each in NAMES if FORMATS[each]().recognises(tmp_path / "a.unknown", head)]

    assert recognising == [name]
    assert load(path.rename(tmp_path / "b.unknown"))[0].source.format == name


@pytest.mark.parametrize(
    "head",
    [b"", b"\0", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", b"PK\x03\x04\x14\0\0\0", b"{}", b"[1, 2, 3]", b"hello\n"],
)
@pytest.mark.parametrize("name", NAMES)
def test_a_format_does_not_recognise_what_is_nobodys(name: str, head: bytes) -> None:
    assert not FORMATS[name]().recognises(Path("a.unknown"), head)


def mutations(data: bytes, seed: int) -> list[bytes]:
    """Cut files, files with one wrong byte, with several, and with a piece of themselves in a wrong place."""
    random = np.random.default_rng(seed)
    made = []
    for k in range(MUTATIONS):
        damaged = bytearray(data)
        if k % 4 == 0:
            del damaged[int(random.integers(0, len(data))) :]
        elif k % 4 == 3:
            start, to = random.integers(0, len(data), 2)
            damaged[int(to) : int(to)] = data[int(start) : int(start) + 40]
        else:
            for place in random.integers(
                0, min(len(data), 600 if k % 2 else len(data)), 1 if k % 4 == 1 else 8
            ):
                damaged[int(place)] = int(random.integers(0, 256))
        made.append(bytes(damaged))
    return made


@pytest.mark.parametrize("name", NAMES)
def test_a_damaged_file_gives_recordings_or_a_format_error_and_takes_little_memory(
    name: str, tmp_path: Path
) -> None:
    path = written(name, (RECORDINGS[-1],), tmp_path) or make(name, tmp_path)
    data = path.read_bytes()
    for damaged in mutations(data, seed=5):
        refill(path, damaged)
        tracemalloc.start()
        try:
            back, said = load(path), path.name
        except FormatError as error:
            back, said = (), str(error)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()

        assert all(isinstance(each, Recording) for each in back)
        assert path.name in said
        assert most < MOST_MEMORY


@pytest.mark.parametrize("name", NAMES)
def test_a_file_that_cannot_be_written_is_a_storage_error_and_leaves_nothing(
    name: str, tmp_path: Path
) -> None:
    path = tmp_path / "folder that is not there" / f"a{FORMATS[name].suffixes[0]}"

    with pytest.raises((StorageError, UsageError)):
        save(small(), path)

    assert list(tmp_path.iterdir()) == []
