"""The page as a browser, a screen reader and an attacker see it."""

import re
from collections import Counter
from dataclasses import replace
from html.parser import HTMLParser
from importlib.resources import files
from itertools import pairwise

import numpy as np
import pytest

from servobench.core.finding import Finding, Severity, info, refusal, warning
from servobench.identification.estimators.output_error import simulate_record
from servobench.identification.identify import identify
from servobench.identification.result import Comparison, Result
from servobench.recordings.recording import Recording
from servobench.report.document import Report
from tests.report.conftest import HOSTILE
from tests.report.makers import dataset

VOID = {"meta", "link", "br", "hr", "img", "input"}
INLINE = {"a", "b", "code", "i", "span", "strong", "sub"}
LARGEST = 1_000_000  # bytes


class Page(HTMLParser):
    """All elements of a page with their attributes and the text in them; checks that each is closed in turn."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.texts: list[str] = []
        self._open: list[tuple[str, int]] = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        names = [name for name, _ in attrs]
        assert len(names) == len(set(names)), f"an attribute of <{tag}> stands there twice"
        self.elements.append((tag, {name: value or "" for name, value in attrs}))
        self.texts.append("")
        if tag not in INLINE:
            self.handle_data(" ")
        if tag not in VOID:
            self._open.append((tag, len(self.elements) - 1))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.handle_endtag(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open[-1][0] == tag, f"</{tag}> closes <{self._open[-1][0]}>"
        self._open.pop()

    def handle_data(self, data: str) -> None:
        for _, index in self._open:
            self.texts[index] += data

    def all(self, *tags: str) -> list[tuple[str, dict[str, str]]]:
        return [element for element in self.elements if element[0] in tags]

    def text(self, tag: str) -> list[str]:
        """The texts of all elements of that kind, in one line each."""
        return [
            " ".join(text.split())
            for (found, _), text in zip(self.elements, self.texts, strict=True)
            if found == tag
        ]

    @property
    def words(self) -> str:
        return " ".join(self.text("body"))


@pytest.fixture(scope="module", params=["good", "several", "refused", "run", "timed", "file"])
def page(request: pytest.FixtureRequest) -> Page:
    """Each kind of page in turn."""
    if request.param in ("run", "timed", "file"):
        recording = request.getfixturevalue(request.param)
        return Page(Report(recording, request.getfixturevalue("good")).html())
    return Page(Report(None, request.getfixturevalue(request.param)).html())


def test_nothing_in_a_page_leads_out_of_it_or_runs(page: Page) -> None:
    assert {tag for tag, _ in page.elements} & {
        "script",
        "iframe",
        "img",
        "object",
        "embed",
        "form",
        "base",
        "audio",
    } == set()
    for tag, attributes in page.elements:
        assert [name for name in attributes if name.startswith("on")] == []
        addresses = [
            attributes[name] for name in ("href", "src", "srcset", "action", "data") if name in attributes
        ]
        assert [
            address for address in addresses if not address.startswith("#") and address != "data:,"
        ] == [], tag
        assert re.findall(r"url\((?!#)", attributes.get("style", "") + attributes.get("clip-path", "")) == []
    (style,) = page.text("style")
    assert "url(" not in style
    assert "@import" not in style


def test_the_policy_forbids_everything_but_styles_and_comes_before_them(page: Page) -> None:
    tags = [tag for tag, _ in page.elements]
    (policy,) = [
        a["content"] for _, a in page.all("meta") if a.get("http-equiv") == "Content-Security-Policy"
    ]

    assert policy.startswith("default-src 'none'; style-src 'unsafe-inline'; img-src data:;")
    assert "script-src" not in policy
    assert tags.index("meta") < tags.index("style")


def test_a_page_has_a_language_one_title_and_headings_in_order(page: Page) -> None:
    levels = [int(tag[1]) for tag, _ in page.elements if re.fullmatch(r"h[1-6]", tag)]

    assert page.all("html")[0][1]["lang"] == "en"
    assert levels.count(1) == 1
    assert levels[0] == 1
    assert max(b - a for a, b in pairwise(levels)) <= 1


def test_every_id_is_there_once_and_every_reference_finds_its_own(page: Page) -> None:
    ids = Counter(attributes["id"] for _, attributes in page.elements if "id" in attributes)
    referred = [a["href"][1:] for _, a in page.elements if a.get("href", "").startswith("#")]
    for _, attributes in page.elements:
        referred += attributes.get("aria-labelledby", "").split()
        referred += re.findall(r"url\(#([^)]*)\)", attributes.get("clip-path", ""))

    assert [name for name, times in ids.items() if times > 1] == []
    assert set(referred) - set(ids) == set()


def test_who_can_t_see_is_reported_what_each_figure_and_table_is(page: Page) -> None:
    figures = [attributes for tag, attributes in page.all("svg") if attributes.get("aria-hidden") != "true"]
    descriptions = page.text("desc")

    assert len(figures) == len(descriptions) >= 2
    assert all(attributes["role"] == "img" and attributes["aria-labelledby"] for attributes in figures)
    assert all(re.search(r"\d", text) for text in descriptions), "a description has numbers"
    assert all(attributes.get("scope") in ("col", "row") for _, attributes in page.all("th"))
    assert page.all("a")[0][1] == {"class": "skip", "href": "#content"}


def test_a_page_is_smaller_than_a_megabyte(good: Result, several: Result) -> None:
    assert max(len(Report(None, result).html().encode()) for result in (good, several)) < LARGEST


def test_a_hundred_times_as_many_samples_make_no_larger_page() -> None:
    short = identify(dataset(samples=2000, noise=1.0))
    assert short.fit is not None
    data = dataset(samples=200_000, noise=1.0)
    model = replace(short.fit.model, data=data)
    # The same model of the long record: to search for it there would take twenty times as long as the page.
    record = simulate_record(model.structure, model.theta, data)
    long = replace(short, data=(data,), fit=replace(short.fit, model=model, records=(record,)))

    sizes = [len(Report(None, result).html().encode()) for result in (short, long)]

    # Noise needs four points in a column of pixels, however many samples there are.
    assert sizes[1] < 1.5 * sizes[0]


def test_a_hostile_name_is_shown_and_does_nothing(several: Result, run: Recording) -> None:
    hostile = replace(
        run,
        name=HOSTILE,
        experiment=f'[experiment]\nname = "{HOSTILE[:27]}"\nnotes = "</code></pre><script>1</script>"\n[signal]\ntype="<b>"',
        versions={HOSTILE: HOSTILE},
        source=replace(run.source, name=HOSTILE, format=HOSTILE, sha256=HOSTILE),
        stopped=replace(run.stopped, sentence=HOSTILE),
    )
    result = replace(several, findings=(warning("code", HOSTILE, parameters=(HOSTILE,)),))

    text = Report([hostile, run], result, command=HOSTILE).html()

    assert "<script" not in text
    assert "<b>signal" not in text
    assert "<script>alert('x')</script> & $\\frac{1}{2}$ 中" in Page(text).words
    text.encode("utf-8", "replace")


@pytest.mark.parametrize(
    ("findings", "word", "reason"),
    [
        ((), "Trusted", "No check found anything against it."),
        ((warning("a", "Careful."),), "Doubtful", "1 warning: read it before you use the numbers."),
        ((refusal("a", "No."), refusal("b", "No.")), "Refused", "2 findings speak against any model."),
    ],
)
def test_the_verdict_is_reported_by_a_word_and_a_symbol_beside_its_colour(
    good: Result, findings: tuple[Finding, ...], word: str, reason: str
) -> None:
    page = Page(Report(None, replace(good, findings=findings)).html())

    (index,) = [
        n for n, (tag, a) in enumerate(page.elements) if tag == "p" and "verdict" in a.get("class", "")
    ]
    assert page.texts[index].split() == [word, *reason.split()]
    assert page.elements[index + 1][0] == "svg"
    assert word.lower() in page.text("title")[0]


def test_the_answer_has_gain_and_time_constant_with_their_intervals(good: Result) -> None:
    words = Page(Report(None, good).html()).words.replace("\u00a0", " ")

    gain, tau = good.fit["gain"], good.fit["time_constant"]  # type: ignore[index]
    found = re.search(r"Each volt adds ([\d.]+) ± ([\d.]+) rad/s .* step in ([\d.]+) ± ([\d.]+) ms\.", words)
    assert found is not None
    told = [float(number) for number in found.groups()]
    # Both are rounded to two digits of the half interval: half of the last digit, 5 % of it at the most.
    for value, half, estimate, scale in ((told[0], told[1], gain, 1), (told[2], told[3], tau, 1000)):
        assert half == pytest.approx(1.959964 * estimate.sd * scale, rel=0.05)
        assert abs(value - estimate.value * scale) <= 0.05 * half


def test_a_refused_result_says_first_why_and_what_to_measure_and_shows_the_data(refused: Result) -> None:
    page = Page(Report(None, refused).html())
    headings = page.text("h2")

    assert refused.fit is None
    assert headings[0] == "Why it was refused, and what else was found"
    assert "record steps between at least two levels" in page.words
    assert "Data" in headings
    assert "Model" not in headings
    assert "Input and output over time." in page.words


def test_a_refused_fit_is_shown_with_a_word_against_its_use(good: Result) -> None:
    words = Page(Report(None, replace(good, findings=(refusal("unknown", "No."),))).html()).words

    assert "Don't use these numbers." in words


def test_findings_stand_with_the_worst_first_and_alike_ones_together(good: Result) -> None:
    findings = (
        info("a", "I one"),
        warning("b", "W one"),
        refusal("c", "R one"),
        warning("b", "W two", rows=(3, 9)),
    )

    words = Page(Report(None, replace(good, findings=findings)).html()).words

    places = [
        words.index(text)
        for text in ("Refusal. R one.", "Warning. W one.", "1 more like this", "W two.", "I one.")
    ]
    assert places == sorted(places)
    assert "rows 3 to 9" in words


def test_of_eight_records_six_are_drawn_and_the_reader_is_reported(several: Result) -> None:
    page = Page(Report(None, several).html())

    assert page.words.count("6 of 8 records are shown.") == 2
    drawn = [text for text in page.text("text") if text.startswith("test ")]
    assert sorted(set(drawn)) == [f"test {n}" for n in range(2, 7)]


def test_a_run_tells_what_was_asked_and_what_happened(good: Result, run: Recording) -> None:
    page = Page(Report(run, good).html())
    facts = dict(zip(page.text("dt"), page.text("dd"), strict=True))

    assert page.text("h1") == ["Experiment ‘paper’ on twin"]
    assert facts["Signal"] == "square: low 1 V, high 3 V"
    assert facts["Duration"] == "3 s"
    assert facts["Ended"] == "ran for 3 s, as asked"
    assert facts["Samples"] == "1500 samples in 2.998 s"
    assert facts["Late"] == "7 of 1500 samples; the latest by 0.4 ms"
    assert facts["Limited by the device"] == "never"
    assert facts["Output"] == "counts (counts, 2048 counts a turn, 24-bit counter)"
    assert facts["Device"] == "twin, serial number simulated, virtual time"
    assert "servobench run experiment.toml" in page.words


def test_a_file_of_somebody_else_s_is_named_with_its_check_sum_and_a_command(
    good: Result, file: Recording
) -> None:
    provenance = replace(good.provenance, inputs_sha256=("ab" * 32,))
    page = Page(Report(file, replace(good, provenance=provenance)).html())

    assert "these data were recorded elsewhere" in page.words
    assert "my data.csv (csv)" in page.words
    assert "ab" * 32 in page.words
    assert "servobench identify 'my data.csv' --input applied:V --output counts:counts" in page.words


def test_the_command_that_was_typed_is_reported_rather_than_one_made_up(
    good: Result, file: Recording
) -> None:
    words = Page(Report(file, good, command="servobench identify x.csv --nominal a").html()).words

    assert "servobench identify x.csv --nominal a" in words
    assert "--input applied" not in words


def test_an_experiment_that_can_t_be_read_is_shown_as_it_is(good: Result, run: Recording) -> None:
    page = Page(Report(replace(run, experiment="what = [is this"), good).html())

    assert "what = [is this" in page.words


def test_nominal_values_stand_beside_the_identified_ones(good: Result) -> None:
    comparisons = (
        Comparison(name="gain", nominal=20.0, identified=21.0, sd=0.25, unit="rad/(s·V)"),
        Comparison(name="delay", nominal=0.0, identified=0.001, sd=np.inf, unit="s"),
    )

    words = Page(Report(None, replace(good, nominal=comparisons)).html()).words.replace("\u00a0", " ")

    assert "Gain outside the interval of the data 20 rad/(s·V) 21.00 ± 0.49 rad/(s·V) +5 % +4" in words
    assert "Delay not determined 0 s 1 ms – –" in words
    assert "gain 5 % ± 2.4 %" in words  # in the figure's description


def test_a_parameter_that_the_data_don_t_tell_has_no_interval(good: Result) -> None:
    fit = good.fit
    assert fit is not None
    covariance = fit.covariance.copy()
    delay = fit.model.names.index("delay")
    covariance[delay, delay] = np.inf

    words = Page(Report(None, replace(good, fit=replace(fit, covariance=covariance))).html()).words

    assert "not determined by the data" in words
    assert "The 95 % band of the phase isn't known" in words
    assert "The 95 % band of the magnitude is thinner than the line" in words


def test_options_and_quoted_names_in_a_finding_are_set_as_code(good: Result) -> None:
    findings = (info("a", "`t<0` is the time; say --time t:ms if not."),)

    text = Report(None, replace(good, findings=findings)).html()

    assert "<code>t&lt;0</code> is the time; say <code>--time</code> t:ms if not." in text


def test_severities_have_a_word_each(good: Result) -> None:
    findings = tuple(Finding(code="c", severity=severity, sentence="S.") for severity in Severity)

    words = Page(Report(None, replace(good, findings=findings)).html()).words

    assert all(f"{word}. S." in words for word in ("Refusal", "Warning", "Information"))


def luminance(colour: str) -> float:
    """The relative luminance of WCAG 2.2."""
    parts = [int(colour[n : n + 2], 16) / 255 for n in (1, 3, 5)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    light, dark = sorted((luminance(one), luminance(other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("theme", [0, 1], ids=["light", "dark"])
def test_text_and_lines_have_the_contrast_of_wcag_aa(theme: int) -> None:
    style = files("servobench.report").joinpath("style.css").read_text(encoding="utf-8")
    blocks = re.findall(r":root \{(.*?)\}", style, re.DOTALL)
    colour = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6});", blocks[theme]))

    for name in ("ink", "muted", "accent"):
        for paper in ("paper", "raised", "shade"):
            assert contrast(colour[name], colour[paper]) >= 4.5, (name, paper)
    for name in ("trusted", "doubtful", "refused"):
        assert contrast(colour[name], colour[f"{name}-paper"]) >= 4.5, name
        assert contrast(colour[name], colour["paper"]) >= 4.5, name
        assert contrast(colour["ink"], colour[f"{name}-paper"]) >= 4.5, name
    for name in ("measured", "model"):
        assert contrast(colour[name], colour["paper"]) >= 3, name
        assert contrast(colour[name], colour["shade"]) >= 2.8, name


def test_a_run_that_was_saved_keeps_its_title_and_names_its_file(good: Result, run: Recording) -> None:
    saved = replace(run, source=replace(run.source, name="day 1/recording.mcap", format="mcap"))

    page = Page(Report(saved, good).html())

    assert page.text("h1") == ["Experiment ‘paper’ on twin"]
    assert page.words.count("servobench identify 'day 1/recording.mcap' To cite") == 1
