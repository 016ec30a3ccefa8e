"""The protocol: what is generated from its table is up to date, and frames survive whatever they carry."""

import importlib.util
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servobench.core.errors import FormatError
from servobench.rig.wire.frames import Reader, check16, decode, encode
from servobench.rig.wire.messages import Message, protocol

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def tool() -> Iterator[ModuleType]:
    spec = importlib.util.spec_from_file_location(
        "write_rig_protocol", ROOT / "tools" / "write_rig_protocol.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_firmware_s_header_is_that_of_the_table(tool: ModuleType) -> None:
    assert tool.HEADER.read_text(encoding="utf-8") == tool.header()


def test_the_page_has_the_tables_of_the_table(tool: ModuleType) -> None:
    text = tool.PAGE.read_text(encoding="utf-8")

    assert tool.page(text) == text


def test_codes_and_names_are_given_once() -> None:
    codes = [each.code for each in protocol().messages]

    assert len(codes) == len(set(codes))
    for section, names in protocol().codes.items():
        assert len(set(names.values())) == len(names), section


@pytest.mark.parametrize("message", protocol().messages, ids=lambda message: message.name)
def test_a_message_reads_back_as_it_was_written(message: Message) -> None:
    values = {
        field.name: tuple(range(field.count)) if field.count > 1 else place
        for place, field in enumerate(message.fields)
    }
    payload = message.pack(300, **values)
    if message.checked:
        checked = message.pack(300, **{name: value for name, value in values.items() if name != "check"})
        assert checked[:-2] == payload[:-2]
        assert int.from_bytes(checked[-2:], "little") == check16(checked[:-2])

    assert message.unpack(payload) == {"sequence": 300 & 0xFF, **values}
    assert protocol().of(payload) == message
    with pytest.raises(FormatError, match="expected"):
        message.unpack(payload + b"x")


@given(st.lists(st.binary(min_size=1, max_size=300)), st.integers(1, 50))
def test_payloads_come_out_of_a_stream_however_it_is_cut(payloads: list[bytes], size: int) -> None:
    stream = b"".join(map(encode, payloads))
    reader = Reader()
    found = [
        payload
        for first in range(0, len(stream), size)
        for payload in reader.feed(stream[first : first + size])
    ]

    assert found == payloads
    assert reader.damaged == 0


def test_both_checksums_together_notice_any_five_flipped_bits_of_the_longest_frame_from_the_host() -> None:
    """Both are linear: damage passes where the sum of its bits' own remainders is 0, by both polynomials at once."""
    bits = 8 * (max(each.struct.size for each in protocol().messages if each.checked) + 2)
    own, second = [1], [1]
    for polynomial, remainders in ((0x1021, own), (0x8BB7, second)):
        while len(remainders) < bits:
            double = remainders[-1] << 1
            remainders.append(double ^ (0x10000 | polynomial) if double >> 16 else double)
    # The second one ends where the first begins.
    single = np.array([low | high << 16 for low, high in zip(own, [0] * 16 + second, strict=False)])
    first, then = np.triu_indices(bits, 1)
    pairs = single[first] ^ single[then]
    triples = np.concatenate([pairs[first > k] ^ single[k] for k in range(bits)])

    assert len(np.unique(np.concatenate([[0], single, pairs]))) == 1 + bits + len(pairs)  # none of 1 to 4
    assert not np.isin(triples, pairs).any()  # nor of 5


@given(st.binary(min_size=1, max_size=80), st.integers(0, 10_000))
def test_a_flipped_bit_is_noticed(payload: bytes, place: int) -> None:
    frame = bytearray(encode(payload)[:-1])
    frame[place % len(frame)] ^= 1 << place % 8

    assert 0 in frame or decode(bytes(frame)) is None


@pytest.mark.parametrize("length", [253, 254, 255, 508, 600])
@pytest.mark.parametrize(("before", "after"), [(b"", b""), (b"\0", b""), (b"", b"\0"), (b"", b"\0\0a")])
def test_a_long_run_without_a_zero_is_stuffed_in_blocks_and_comes_back(
    length: int, before: bytes, after: bytes
) -> None:
    payload = before + bytes(1 + k % 255 for k in range(length)) + after

    frame = encode(payload)

    assert frame.index(0) == len(frame) - 1
    assert decode(frame[:-1]) == payload
