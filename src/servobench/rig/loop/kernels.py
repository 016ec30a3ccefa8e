"""Compiled kernels of the ring: one process publishes records, any number of others copy them, and none of them waits.

The memory is laid out in `loop.segment`. Record n stands in slot n mod `slots`; `head` is how many are published. The writer

    fence (release);  write record n = head into its slot;  store head = n + 1 (release)

and a reader

    load head (acquire);  copy records;  fence (acquire);  load head again, as h

A reader that sees head = n + 1 sees the whole of record n. While head is h, the writer may be writing record h over h - slots.
If a copy contains a word of record m, then head was m before that word was written (the writer's fence), and the reader finds h
>= m after the copy (the reader's fence). So copies of records n > h - slots are complete, and all others are thrown away.

On x86-64 both fences only bind the compiler. ARM reorders stores with stores and loads with loads, and there they are
instructions: a release store alone would let the next record's words overtake it, and an acquire load alone might be done before
the copy is. (Boehm 2012, Can seqlocks get along with programming language memory models?)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from numba import types
from numba.core.errors import TypingError
from numba.extending import intrinsic

from servobench.core.channels import Array
from servobench.core.compiled import compiled
from servobench.rig.loop.segment import FIRST_WORD, HEAD, HEADER, LINE, SLOTS, WIDTH, Memory

Lowering = tuple[Any, Callable[..., Any]]


def instruction(lowering: Callable[..., Lowering]) -> Callable[..., Any]:
    """Make an instruction that Numba has no word for, from how it is typed and built."""
    return cast(Callable[..., Any], intrinsic(lowering))


@instruction
def load_acquire(_typing: Any, memory: Any, index: Any) -> Lowering:
    """Return memory[index], and see all that its writer had written before."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        return builder.load_atomic(builder.gep(array.data, [arguments[1]]), ordering="acquire", align=8)

    return types.int64(memory, types.int64), codegen


@instruction
def store_release(_typing: Any, memory: Any, index: Any, value: Any) -> Lowering:
    """Set memory[index] after everything that was written before."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        builder.store_atomic(
            arguments[2], builder.gep(array.data, [arguments[1]]), ordering="release", align=8
        )
        return context.get_dummy_value()

    return types.void(memory, types.int64, types.int64), codegen


@instruction
def fence_release(_typing: Any) -> Lowering:
    """Let nothing that is written from here on be seen before what was written until here."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.fence("release")
        return context.get_dummy_value()

    return types.void(), codegen


@instruction
def fence_acquire(_typing: Any) -> Lowering:
    """Finish all that is being read before anything else is read."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.fence("acquire")
        return context.get_dummy_value()

    return types.void(), codegen


@instruction
def copy_word(_typing: Any, target: Any, i: Any, source: Any, j: Any) -> Lowering:
    """Set number i of one array to the bits of number j of another, both counted as they lie in memory, in one piece.

    Another process may be at the same place at the same time: that is defined for atomic accesses only. Their order is
    left to the fences.
    """
    for array in (target, source):
        if array.layout != "C" or array.dtype not in (types.float64, types.int64):
            raise TypingError(f"a ring takes rows of float64 or int64 that lie in one piece, not {array}")

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        bits = context.get_value_type(types.int64)
        places = []
        for kind, array, index in zip(signature.args[::2], arguments[::2], arguments[1::2], strict=True):
            data = context.make_array(kind)(context, builder, array).data
            places.append(builder.gep(builder.bitcast(data, bits.as_pointer()), [index]))
        word = builder.load_atomic(places[1], ordering="monotonic", align=8)
        builder.store_atomic(word, places[0], ordering="monotonic", align=8)
        return context.get_dummy_value()

    return types.void(target, types.int64, source, types.int64), codegen


@compiled
def count_written(memory: Memory) -> int:
    """Return how many records were published so far."""
    head: int = load_acquire(memory, HEAD)
    return head


@compiled
def get_word(memory: Memory, word: int) -> int:
    """Return one of the words, 0 to 7."""
    value: int = load_acquire(memory, FIRST_WORD + LINE * word)
    return value


@compiled
def set_word(memory: Memory, word: int, value: int) -> None:
    """Set one of the words, 0 to 7."""
    store_release(memory, FIRST_WORD + LINE * word, value)


@compiled
def push_row(memory: Memory, row: Array | Memory) -> None:
    """Publish a row (width,) of 64-bit numbers or integers; only one thread of one process may."""
    width = memory[WIDTH]
    if len(row) != width:
        raise ValueError("the row is not as wide as the ring's slots")
    head = memory[HEAD]
    slot = HEADER + (head & (memory[SLOTS] - 1)) * width
    fence_release()
    for k in range(width):
        copy_word(memory, slot + k, row, k)
    store_release(memory, HEAD, head + 1)


@compiled
def read_rows(memory: Memory, first: int, out: Array | Memory) -> tuple[int, int, int]:
    """Copy rows from number `first` on, or from the oldest that is left, into `out` (N, width); return (number, from, to).

    out[from:to] is whole, and its first row is that `number`; those from `first` until there are lost. So the reader goes on
    at number + to - from, and has missed number - first more. Where from = to there was nothing to read, or what was copied was
    overwritten meanwhile.
    """
    slots, width = memory[SLOTS], memory[WIDTH]
    if out.shape[1] != width:
        raise ValueError("the rows are not as wide as the ring's slots")
    head = load_acquire(memory, HEAD)
    start = max(first, head - slots + 1)
    count = max(0, min(head - start, len(out)))
    for n in range(count):
        slot = HEADER + ((start + n) & (slots - 1)) * width
        for k in range(width):
            copy_word(out, n * width + k, memory, slot + k)
    fence_acquire()
    number = max(start, load_acquire(memory, HEAD) - slots + 1)
    return number, min(number - start, count), count
