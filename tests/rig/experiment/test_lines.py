"""The line of each key, in TOML texts of every shape: each value is the number of the line that its key stands in."""

import tomllib
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servobench.core.toml import table_lines
from servobench.rig.experiment.lines import Path, line_of, lines_of_keys

TEXTS = {
    "tables": """a = 1
[b]
c = 3 # c = 4
[b.d]
# e = 0

e = 7
[f.g]
c = 9
""",
    "dotted and quoted keys": """"a b".c = 1
a . "d.e" = 2
'x"y'.z = 3
"\\u0078" = 4
[ t . 'u.v' ]
w.w = 6
1.2 = 7
""",
    "arrays of tables": """[[p]]
a = 2
[[p.q]]
b = 4
[[p.q]]
b = 6
[p.q.r]
c = 8
[[p]]
a = 10
[[p.q]]
b = 12
[p.s]
d = 14
[q]
b = 16
""",
    "inline tables and arrays": """a = {b = 1, c = {d = 1, "e" = 1}, f.g = 1}
h = [
  3, # ]
  {i = 4}, {i = 4, j = [4,
   5,]},

  [7], [[
   8]],
]
k = 10
l = [[], {}, [{}]]
m = 12
""",
    "texts that look like something else": r'''a = ["# ] }", '"', 1]
b = """
c = 3 # "" \""" [d]
e = 4"""""
f = 5
g = \'\'\'
h = 7 ' \\
\'\'\'''\'\'
i = 9
j = { k = "}, l = 10", m = 10 }
n = ""
o = 12
p = \'\'
q = 14
r = """"""
s = 16
t = "\\"
u = 18
'''.replace(r"\'", "'").replace("'''''\n", "'''\n"),
    "values of all kinds": """a = 1
b = [1979-05-27T07:32:00Z, 07:32:00, 1979-05-27 07:32:00.5-07:00, 2] # 3
c = [true, -inf, 0x3, 1_0, 3]
d = 4
""",
    "windows": "a = 1\r\n[b]\r\nc = 3\r\nd = [\r\n5,\r\n6]\r\ne = '''\r\n'''\r\nf = 9",
    "no newline at the end": "[a]\nb = 2",
}


def leaves(value: Any, path: Path = ()) -> dict[Path, Any]:
    """Return all values that are no tables or arrays, by where they stand."""
    if isinstance(value, dict):
        items = value.items()
    elif isinstance(value, list):
        items = enumerate(value)
    else:
        return {path: value}
    return {place: leaf for key, item in items for place, leaf in leaves(item, (*path, key)).items()}


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_each_key_is_found_in_its_line(text: str) -> None:
    lines = lines_of_keys(text)

    found = leaves(tomllib.loads(text))
    assert found.keys() <= lines.keys()
    numbers = {
        path: value for path, value in found.items() if type(value) is int and value < text.count("\n") + 2
    }
    assert numbers == {path: lines[path] for path in numbers}
    assert len(numbers) >= 1


KEYS = st.text(max_size=6)
VALUES = st.recursive(
    st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=12,
)


@given(st.dictionaries(KEYS, VALUES, max_size=4))
def test_whatever_is_written_reads_back_the_same_and_each_of_its_keys_has_a_line(
    table: dict[str, Any],
) -> None:
    text = "\n".join(table_lines(("t",), table))

    assert tomllib.loads(text) == {"t": table}
    assert leaves({"t": table}).keys() <= lines_of_keys(text).keys()


def test_atable_lines_stands_where_its_header_or_its_first_key_does() -> None:
    lines = lines_of_keys("a = 1\n[b]\n[c.d]\ne = 1\n[[f]]\n[[f]]\nx = {y = 1}")

    assert {
        path: lines[path] for path in [("b",), ("c",), ("c", "d"), ("f",), ("f", 0), ("f", 1), ("f", 1, "x")]
    } == {
        ("b",): 2,
        ("c",): 3,
        ("c", "d"): 3,
        ("f",): 5,
        ("f", 0): 5,
        ("f", 1): 6,
        ("f", 1, "x"): 7,
    }


def test_what_is_missing_is_looked_for_in_the_nearesttable_lines_around_it() -> None:
    lines = lines_of_keys("[a]\nb = 2\n[a.c]\n")

    assert line_of(("a", "b"), lines) == 2
    assert line_of(("a", "x", "y"), lines) == 1
    assert line_of(("a", "c", "x"), lines) == 3
    assert line_of(("z",), lines) is None
    assert line_of((), lines) is None
