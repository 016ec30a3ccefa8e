"""Formulas: what is written in a line is set as it is meant, reads well as text, and says what can't be read."""

import re
import xml.etree.ElementTree as ET

import pytest

from servobench.core.errors import FormatError
from servobench.lab.exercise_file import exercises, read_exercise
from servobench.lab.formula import formula_html, formula_text, line_html, line_text
from servobench.lab.markdown import as_text, to_html

TIMES, OF = "\u2062", "\u2061"


def said(element: ET.Element) -> str:
    """The meaning of a MathML element, all brackets written out, by the standard's meaning of the elements alone."""
    inner = [said(each) for each in element if each.tag != "mspace"]
    match element.tag:
        case "mfrac":
            return f"[{inner[0]}]/[{inner[1]}]"
        case "msup":
            return f"{inner[0]}^[{inner[1]}]"
        case "msub":
            return f"{inner[0]}_[{inner[1]}]"
        case "msubsup":
            return f"{inner[0]}_[{inner[1]}]^[{inner[2]}]"
        case "msqrt":
            return f"√[{''.join(inner)}]"
        case "mi" | "mn" | "mo" | "mtext":
            return (element.text or "").replace(TIMES, "*").replace(OF, " of ")
        case _:
            return "".join(inner)


def meant(source: str, *, display: bool = True) -> str:
    return said(ET.fromstring(formula_html(source, display=display)))


@pytest.mark.parametrize(
    ("source", "meaning"),
    [
        ("K/(τs + 1)", "[K]/[τ*s+1]"),
        ("ω_n²/(s² + 2ζω_n s + ω_n²)", "[ω_[n]^[2]]/[s^[2]+2*ζ*ω_[n]*s+ω_[n]^[2]]"),
        ("e^(−t/τ)", "e^[−[t]/[τ]]"),
        ("e⁻¹", "e^[−1]"),
        ("J dΩ/dt = T", "J*[dΩ]/[dt]=T"),  # the blank ends what the stroke takes
        ("R·J/k²", "[R·J]/[k^[2]]"),  # and a point doesn't
        ("(1/k)/((R·J/k²) s + 1)", "[[1]/[k]]/[[R·J]/[k^[2]]*s+1]"),
        ("(a/b)²", "([a]/[b])^[2]"),  # these brackets say something
        ("√(1 + (ωτ)²)", "√[1+(ω*τ)^[2]]"),
        ("|G(jω)| = K", "|G of (j*ω)|=K"),
        ("u = kp (r − θ)", "u=kp*(r−θ)"),
        ("arctan ωτ", "arctan of ω*τ"),
        ('K · "counts"', "K·counts"),
        ("1 - x_(a, b)", "1−x_[a,b]"),
    ],
)
def test_a_formula_is_set_as_it_is_meant(source: str, meaning: str) -> None:
    assert meant(source) == meaning


def test_in_a_line_a_fraction_has_a_stroke_and_keeps_its_brackets() -> None:
    assert meant("K/(τs + 1)", display=False) == "K/(τ*s+1)"


@pytest.mark.parametrize(
    ("source", "text"),
    [
        ("2ζω_n s", "2ζωₙ s"),
        ("u_c", "u_c"),  # there is no small c
        ("s^2 + x^(-1)", "s² + x⁻¹"),
        ("e^(−t/τ)", "e^(−t/τ)"),
        ('K · "counts"', "K · counts"),
    ],
)
def test_a_formula_is_a_line_of_text_in_a_terminal(source: str, text: str) -> None:
    assert formula_text(source) == text
    assert ET.fromstring(formula_html(source)).attrib["alttext"] == text


@pytest.mark.parametrize(
    ("source", "why"),
    [
        ("K/(τs + 1", "expected ')'"),
        ("K/", "both sides of '/'"),
        ("a/b/c", "add brackets"),
        ("a/b·c", "add brackets"),
        ("½ x", "'½' has no meaning"),
        ("x^", "it ends too early"),
        ("a + )", "can't stand there"),
        ("()", "nothing between two brackets"),
    ],
)
def test_what_cannot_be_read_is_reported(source: str, why: str) -> None:
    with pytest.raises(FormatError, match=r"the formula \$.* can't be read") as caught:
        formula_html(source)

    assert why in str(caught.value)


def test_nothing_of_a_formula_becomes_a_tag() -> None:
    html = formula_html('x < y "<b>"')

    assert "<b>" not in html
    assert "&lt;b&gt;" in html


def test_an_index_in_a_line_is_set_and_names_with_underscores_are_left_alone() -> None:
    assert line_html("2ζω_n & J_eq") == "2ζ<i>ω</i><sub>n</sub> &amp; <i>J</i><sub>eq</sub>"
    assert line_text("ω_n², t_p, J_eq") == "ωₙ², tₚ, J_eq"
    assert line_text("first_order, sheet_gain_2, a_b_c") == "first_order, sheet_gain_2, a_b_c"


def test_money_and_code_are_no_formulas() -> None:
    assert "<math" not in to_html("From 5 $ to 7 $, or $5 and $7, `$K$` and \\$K$.")


def test_a_formula_by_itself_is_shown_large() -> None:
    assert to_html("$$1/s$$").startswith('<p><span class="shown"><math display="block"')


def test_a_comma_stays_with_its_formula() -> None:
    html = to_html("In $K$, $τ$ and $ω_n$ (or $ζ$).")

    assert re.findall(r'<span class="kept"><math [^>]*alttext="(.*?)".*?</math>(.*?)</span>', html) == [
        ("K", ","),
        ("ζ", ")."),
    ]


def test_a_terminal_gets_text() -> None:
    inline = as_text("The frequency $ω_n$ of $$1/s$$.")[1]

    assert "".join(each.content for each in inline.children or ()) == "The frequency ωₙ of 1/s."


def test_a_mistake_in_a_formula_is_reported_with_file_and_line_when_the_exercise_is_read() -> None:
    front = """+++
title = "x"
[experiment]
duration = "1 s"
[signal]
type = "step"
[[blanks]]
id = "a"
label = "a"
answer = "1"
tolerance = "exact"
"""
    with pytest.raises(FormatError, match=r"my\.md:15: the formula \$K/\(s\$ can't be read: expected '\)'"):
        read_exercise(f"{front}+++\n\nOne line.\nA $K/(s$.\n", "my", "my.md")


def test_no_exercise_has_a_formula_that_is_left_as_it_was_typed() -> None:
    """Greek letters, roots and exponents in a text stand in formulas."""
    for exercise in exercises():
        outside = re.sub(r"<math.*?</math>|<code>.*?</code>", "", to_html(exercise.text), flags=re.DOTALL)
        assert not set("τωζθΩ√²³") & set(outside), exercise.name
