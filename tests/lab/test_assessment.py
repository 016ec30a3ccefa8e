"""A motor for each student: it can't be told but by measuring, stays the same, and is marked by its own recording."""

import csv
import io
import json
import math
import os
import re
import stat
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

import servobench as sb
from servobench.core.errors import FormatError, NotIdentifiable, StorageError, UsageError
from servobench.lab.assessment.assigned_stand import Assessment
from servobench.lab.assessment.forms import NAME, blank_form, forms_in, read_form
from servobench.lab.assessment.handout import Handout, hand_out
from servobench.lab.assessment.marking import Mark, StudentMarks, Verdict, mark, marks_table
from servobench.lab.assessment.questions import (
    Question,
    form_pass_rate,
    pass_rates,
    questions,
    same_for_all,
)
from servobench.lab.assessment.roster import Student, read_roster
from servobench.lab.assessment.tables import harmless, read_table, strip_apostrophe
from servobench.lab.exercise import Blank
from servobench.lab.exercise_file import exercise, exercises, load_exercise
from servobench.lab.stand import MotorStand
from servobench.lab.truth import truth_of
from servobench.rig.experiment.experiment import DeviceChoice
from servobench.rig.motor.individual import (
    COULOMB_VOLTAGE,
    GAIN,
    RESISTANCE,
    TIME_CONSTANT,
    VISCOUS_FRICTION,
    Individual,
    individual,
)
from servobench.rig.motor.secret import hash_words, new_secret, read_secret

SECRET = bytes(range(32))
FOR_EVER: dict[str, Any] = {
    "gain": "7a8bfe4172f4015750350ce5c020cc952b819d0fee408633ff46f72e1e714a9c",
    "resistance": 12.303378944927687,
    "motor_constant": 0.042889355580419036,
    "inertia": 1.2256669052647139e-05,
    "coulomb_torque": 0.00037740203883950094,
    "noise_seed": 80856757879361017962124345136981073253,
}
CLASS = tuple(Student(id=name, folder=name) for name in ("ada", "blaise", "carl"))


STANDS: dict[tuple[str, bool, str], MotorStand] = {}


class Remembering(Assessment):
    """Makes each student's motor run once for all tests: it is the same every time, which a test of its own shows."""

    def stand(self, student: str) -> MotorStand:
        key = (self.exercise.name, self.with_motor, student)
        if self.secret != SECRET or self.exercise is not exercise(self.exercise.name):
            return super().stand(student)
        if key not in STANDS:
            STANDS[key] = super().stand(student)
        return STANDS[key]


def assessment(secret: Path, name: str = "step", *, with_motor: bool = False) -> Assessment:
    return Remembering(
        exercise=exercise(name), secret_file=secret, secret=read_secret(secret), with_motor=with_motor
    )


@pytest.fixture(scope="module")
def secret(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mine") / "secret"
    path.write_bytes(SECRET)
    path.chmod(0o600)
    return path


@pytest.fixture(scope="module")
def handed(secret: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, tuple[Handout, ...]]:
    folder = tmp_path_factory.mktemp("class") / "hand"
    return folder, hand_out(assessment(secret), CLASS, folder)


# --- the motors


def physical(own: Individual) -> tuple[float, float, float]:
    """Gain, time constant, Coulomb voltage: K = k/(R b + k²), τ = R J/(R b + k²), u_c = T_c R/k."""
    below = own.resistance * own.viscous_friction + own.motor_constant**2
    return (
        own.motor_constant / below,
        own.resistance * own.inertia / below,
        own.coulomb_torque * own.resistance / own.motor_constant,
    )


def test_the_same_secret_and_student_give_the_same_motor_for_ever() -> None:
    """The numbers are written down here: a motor that is handed out in autumn is marked in spring, by a later version."""
    own = individual(SECRET, "step", "Ada Lovelace")

    assert own == individual(SECRET, "step", "  ada\u00a0 LOVELACE ")
    assert (
        hash_words(SECRET, "servobench.individual/1", "step", "ada lovelace", "gain").hex()
        == FOR_EVER["gain"]
    )
    assert own.resistance == pytest.approx(FOR_EVER["resistance"], rel=1e-12)
    assert own.motor_constant == pytest.approx(FOR_EVER["motor_constant"], rel=1e-12)
    assert own.inertia == pytest.approx(FOR_EVER["inertia"], rel=1e-12)
    assert own.coulomb_torque == pytest.approx(FOR_EVER["coulomb_torque"], rel=1e-12)
    assert own.noise_seed == FOR_EVER["noise_seed"]


def test_another_secret_student_or_exercise_gives_another_motor() -> None:
    others = [
        individual(bytes(32), "step", "ada"),
        individual(SECRET, "stepa", "da"),  # the words are kept apart
        individual(SECRET, "step", "blaise"),
        individual(SECRET, "pulse", "ada"),
    ]

    mine = individual(SECRET, "step", "ada")
    for other in others:
        for name in ("resistance", "motor_constant", "inertia", "viscous_friction", "coulomb_torque"):
            assert getattr(mine, name) != getattr(other, name)
        assert mine.noise_seed != other.noise_seed


def test_motors_have_the_ranges_that_are_reported_and_fill_them_evenly() -> None:
    motors = [individual(SECRET, "step", f"s{number}") for number in range(400)]
    gain, time_constant, coulomb = np.array([physical(own) for own in motors]).T
    resistance = np.array([own.resistance for own in motors])
    damping = np.array([own.viscous_friction for own in motors])

    for values, (low, high), part in (
        (gain, GAIN, np.log),
        (time_constant, TIME_CONSTANT, np.log),
        (coulomb, COULOMB_VOLTAGE, np.asarray),
        (resistance, RESISTANCE, np.asarray),
        (damping, VISCOUS_FRICTION, np.asarray),
    ):
        assert low * (1 - 1e-9) <= values.min()
        assert values.max() <= high * (1 + 1e-9)
        within = np.sort((part(values) - part(low)) / (part(high) - part(low)))
        # Kolmogorov and Smirnov: an even spread of 400 is nowhere farther than 1.95/√400 off, but for one time in a thousand.
        assert np.abs(within - (np.arange(400) + 0.5) / 400).max() < 1.95 / 20
    # Who finds out one of them knows no other: 4.5/√400 is beyond what chance does to a correlation.
    together = np.corrcoef([gain, time_constant, coulomb, resistance, damping])
    assert np.abs(together - np.eye(5)).max() < 4.5 / 20


# --- the secret


@pytest.mark.skipif(os.name != "posix", reason="Windows has no such rights")
def test_a_new_secret_is_random_and_belongs_to_its_owner(tmp_path: Path) -> None:
    made = new_secret(tmp_path / "one")

    assert len(made) == 32
    assert made == read_secret(tmp_path / "one")
    assert made != new_secret(tmp_path / "two")
    assert stat.S_IMODE((tmp_path / "one").stat().st_mode) == 0o600
    with pytest.raises(StorageError, match="can't be written"):
        new_secret(tmp_path / "one")  # nothing replaces a secret
    (tmp_path / "one").chmod(0o640)
    with pytest.raises(UsageError, match=r"may be read by others \(mode 640\).*chmod 600"):
        read_secret(tmp_path / "one")


def test_a_secret_that_is_short_long_or_not_there_is_reported(tmp_path: Path) -> None:
    for name, content, said in (
        ("short", b"12345", "has 5 bytes; expected 32"),
        ("long", bytes(5000), "has more than 4096 bytes"),
    ):
        (tmp_path / name).write_bytes(content)
        (tmp_path / name).chmod(0o600)
        with pytest.raises(UsageError, match=said):
            read_secret(tmp_path / name)
    with pytest.raises(UsageError, match="there is no secret"):
        read_secret(tmp_path / "none")


# --- what students get


def everything(folder: Path) -> Iterator[tuple[Path, bytes]]:
    """The bytes of all files, and what is in those that are packed: each message and each metadata of an MCAP file."""
    for path in sorted(folder.rglob("*")):
        if not path.is_file():
            continue
        yield path, path.read_bytes()
        if path.suffix == ".mcap":
            with path.open("rb") as file:
                reader = make_reader(file)
                found = [value for each in reader.iter_metadata() for value in each.metadata.values()]
                summary = repr(reader.get_header()) + repr(reader.get_summary())
                messages = b"".join(message.data for _, _, message in reader.iter_messages())
            yield path, messages + ("\n".join(found) + summary).encode()


def spellings(value: float) -> set[bytes]:
    """The usual ways to write a number, with 6 digits and more, in SI units and with the usual prefixes; and its bytes."""
    found = set()
    for factor in (1.0, 1e3, 1e6):
        scaled = value * factor
        for digits in range(6, 18):
            found |= {f"{scaled:.{digits}g}", f"{scaled:.{digits - 1}e}", f"{scaled:.{digits - 1}E}"}
        found |= {repr(scaled), repr(scaled).replace(".", ",")}
    packed = np.array([value])
    return {each.encode() for each in found if len(each.strip("0.")) >= 6} | {
        packed.astype(kind).tobytes() for kind in ("<f8", ">f8")
    }


def test_nothing_that_a_student_gets_tells_parameters_seed_or_secret(
    handed: tuple[Path, tuple[Handout, ...]], secret: Path
) -> None:
    folder, _ = handed
    hidden: set[bytes] = {SECRET, SECRET.hex().encode(), str(secret).encode(), secret.parent.name.encode()}
    for student in CLASS:
        own = individual(SECRET, "step", student.id)
        gain, time_constant, coulomb = physical(own)
        for value in (
            *(v for v in own.twin_settings.values() if v),
            gain,
            time_constant,
            coulomb,
        ):
            hidden |= spellings(value)
        hidden |= {str(own.noise_seed).encode(), f"{own.noise_seed:x}".encode()}

    looked = 0
    for path, content in everything(folder):
        looked += 1
        for each in hidden:
            assert each not in content, (path, each)
    assert looked == len(CLASS) * 5  # form, page, table, recording, and what is packed in that


def test_the_search_finds_what_is_hidden_where_it_is_reported(tmp_path: Path, secret: Path) -> None:
    """The test above can fail: a recording of the twin itself with the same parameters tells them."""
    own = individual(SECRET, "step", "ada")
    with sb.connect("twin", **own.twin_settings) as motor:
        sb.save(sb.run(sb.Experiment(duration=0.1), motor), tmp_path / "told.mcap")

    (_, _), (_, unpacked) = everything(tmp_path)
    assert any(each in unpacked for each in spellings(own.resistance))


@pytest.mark.parametrize("ending", ["mcap", "csv"])
def test_a_recording_is_read_back_without_the_twins_settings_and_can_be_identified(
    handed: tuple[Path, tuple[Handout, ...]], ending: str
) -> None:
    folder, _ = handed
    (recording,) = sb.load(folder / "ada" / f"step.{ending}")

    assert recording.info is not None
    assert recording.info.settings == ()
    assert (recording.events, recording.findings, dict(recording.versions)) == ((), (), {})
    assert "seed = 0" in recording.experiment
    assert "[device.settings]" not in recording.experiment
    with pytest.raises(NotIdentifiable, match="aren't known for the motor in"):
        truth_of(recording)
    found = sb.identify(sb.measure(recording)).fit
    assert found is not None
    _, time_constant, _ = physical(individual(SECRET, "step", "ada"))
    # A step in one direction: friction takes a part of the gain, not of the time constant. 2 % is more than the electrical
    # time constant, 1.16 mH/5 Ω = 0.2 ms, takes of τ above 40 ms, and its interval.
    low, high = found["time_constant"].interval
    assert abs(found["time_constant"].value / time_constant - 1) < 0.02 + (high - low) / time_constant


def test_the_page_has_no_answers_and_no_studies_and_says_where_answers_go(
    handed: tuple[Path, tuple[Handout, ...]],
) -> None:
    folder, made = handed
    page = (folder / "ada" / "step.html").read_text(encoding="utf-8")

    assert 'class="study' not in page
    assert "Errors in the paper" not in page
    assert "<code>answers.csv</code>" in page
    assert "--answers" not in page  # which would check against another motor
    texts = set(re.findall(r"\d+\.\d{3,}", re.sub(r"(?s)<(svg|style|script).*?</\1>", "", page)))
    for question in made[0].asked:
        assert f"{question.right:.4g}" not in texts


def test_the_form_has_each_blank_and_no_answer(handed: tuple[Path, tuple[Handout, ...]]) -> None:
    folder, _ = handed
    form = read_form(folder / "ada" / NAME)

    assert form is not None
    assert dict(form.answers) == {blank.id: "" for blank in exercise("step").blanks}
    # Behind a letter: a spreadsheet takes twelve digits, or 12e345678901, for a number, and would save it rounded.
    assert re.fullmatch(r"k[0-9a-f]{12}", form.code)
    assert form.code == f"k{assessment_code('ada')}"
    assert form.code != f"k{assessment_code('blaise')}"


def assessment_code(student: str) -> str:
    """The code by the standard library alone: HMAC-SHA256 of the words, each behind its length in four bytes."""
    import hashlib
    import hmac

    words = [b"servobench.form/1", b"step", student.encode()]
    message = b"".join(len(word).to_bytes(4, "big") + word for word in words)
    return hmac.new(SECRET, message, hashlib.sha256).hexdigest()[:12]


def test_handing_out_again_gives_the_same_files(secret: Path, tmp_path: Path) -> None:
    once, again = tmp_path / "once", tmp_path / "again"
    made = Assessment(exercise=exercise("step"), secret_file=secret, secret=SECRET)
    hand_out(made, CLASS[:1], once)
    hand_out(made, CLASS[:1], again)

    for name in ("step.csv", "step.mcap", NAME):
        assert (once / "ada" / name).read_bytes() == (again / "ada" / name).read_bytes()


def test_a_secret_in_what_is_handed_out_is_reported_before_anything_is_written(tmp_path: Path) -> None:
    (tmp_path / "hand").mkdir()
    new_secret(tmp_path / "hand" / "secret")

    with pytest.raises(UsageError, match="which is handed out; put it elsewhere"):
        hand_out(assessment(tmp_path / "hand" / "secret"), CLASS, tmp_path / "hand")
    assert [path.name for path in (tmp_path / "hand").iterdir()] == ["secret"]


# --- what can be asked


def test_what_takes_further_runs_is_asked_of_who_has_the_motor(secret: Path) -> None:
    alone = assessment(secret, "driving")
    both = assessment(secret, "driving", with_motor=True)

    asked = {q.blank.id: q for q in questions(alone.exercise, alone.stand("ada"))}
    more = {q.blank.id: q for q in questions(both.exercise, both.stand("ada"))}

    assert not asked["breakaway"].is_answerable
    assert "further runs" in asked["breakaway"].why_not
    assert asked["speed"].right == more["speed"].right
    # On a slow ramp the shaft begins to move at the Coulomb voltage, some counts later.
    _, _, coulomb = physical(individual(SECRET, "driving", "ada"))
    assert coulomb < more["breakaway"].right < 1.1 * coulomb
    # Friction takes its part of 0.5 V: the steady speed is K (0.5 V - u_c); 1 % is what counting over half a second leaves.
    gain, _, _ = physical(individual(SECRET, "driving", "ada"))
    assert asked["speed"].right == pytest.approx(gain * (0.5 - coulomb), rel=0.01)


def test_what_only_the_true_parameters_tell_is_asked_of_nobody(secret: Path) -> None:
    made = assessment(secret, "identification", with_motor=True)

    why = {q.blank.id: q.why_not for q in questions(made.exercise, made.stand("ada"))}

    sentence = why["honesty"]
    assert "aren't known for the motor in" in sentence
    assert not any(word in sentence for word in ("assigned", ".md", "/", "twin"))  # a lecturer reads it
    assert why["gain"] == why["time_constant"] == ""


def test_an_exercise_on_another_device_is_reported(secret: Path) -> None:
    step = exercise("step")
    elsewhere = step.experiment.model_copy(update={"device": DeviceChoice(name="replay")})

    with pytest.raises(UsageError, match="uses the device 'replay'"):
        Assessment(exercise=replace(step, experiment=elsewhere), secret_file=secret, secret=SECRET)


def test_a_rule_with_a_misspelt_fact_is_reported_with_its_line(tmp_path: Path) -> None:
    text = Path(exercise("step").source).read_text(encoding="utf-8")
    (tmp_path / "step.md").write_text(
        text.replace('answer = "read_gain"', 'answer = "red_gain"'), encoding="utf-8"
    )

    with pytest.raises(
        UsageError, match=r"step\.md:\d+: blank 'gain': `red_gain`: no fact called 'red_gain'"
    ):
        load_exercise(tmp_path / "step.md")


def test_a_neighbours_answers_seldom_pass(secret: Path) -> None:
    """Two even draws of ln τ over a range L = ln(high/low) are within a of each other with a probability of 2a/L - (a/L)².

    `step` takes 1.5 ms and an interval, which is less than 5 % of 40 ms; over 600 motors that is held to 3 standard deviations
    of 300 pairs that share no motor.
    """
    tau = np.log([physical(individual(SECRET, "step", f"s{number}"))[1] for number in range(600)])
    whole = math.log(TIME_CONSTANT[1] / TIME_CONSTANT[0])
    chance = 2 * 0.06 / whole - (0.06 / whole) ** 2

    assert abs(np.mean(np.abs(tau[::2] - tau[1::2]) < 0.06) - chance) < 3 * math.sqrt(
        chance * (1 - chance) / 300
    )
    assert chance < 0.1

    made = assessment(secret)
    asked = [questions(made.exercise, made.stand(student.id)) for student in CLASS]
    time_constant = [next(q for q in each if q.blank.id == "time_constant") for each in asked]
    assert all(q.allowed < 0.06 * q.right for q in time_constant)
    by_hand = sum(
        abs(a.right - b.right) <= a.allowed for a in time_constant for b in time_constant if a is not b
    )
    passed = pass_rates(asked)
    assert passed["time_constant"] == by_hand / 6
    assert passed["lag"] == passed["level"] == 1.0  # which have nothing to do with the motor
    assert math.isnan(pass_rates(asked[:1])["lag"])


def test_a_definition_is_everybodys_answer_and_a_measured_one_is_a_students_own(secret: Path) -> None:
    made = assessment(secret)
    asked = [questions(made.exercise, made.stand(student.id)) for student in CLASS]

    same = same_for_all(asked)

    assert {blank for blank, is_same in same.items() if is_same} == {"level", "lag"}  # 1 - 1/e and 1/50
    assert not any(same_for_all(asked[:1]).values())  # with one student nobody can tell


ASSESS = (Path(__file__).parents[2] / "docs" / "how-to" / "assess.md").read_text(encoding="utf-8")
GUIDE = re.findall(r"^\| (`[a-z_`, ]+) \| ([^|]*) \| ([^|]*)\|$", ASSESS, re.MULTILINE)


def test_the_guide_says_of_every_exercise_what_is_a_students_own() -> None:
    told = [name for row in GUIDE for name in re.findall(r"`([a-z_]+)`", row[0])]

    assert {each.name for each in exercises()} <= set(told)


@pytest.mark.parametrize(
    "name", ["encoder", "driving", "step", "stability", "parameter_estimation"]
)  # the quick ones
def test_the_guide_is_right_on_what_is_a_students_own(secret: Path, name: str) -> None:
    row = next(row for row in GUIDE if f"`{name}`" in row[0])
    own = [set(re.findall(r"`([a-z_]+)`", cell)) for cell in row[1:]]

    for with_motor, expected in ((False, own[0]), (True, own[0] | own[1])):
        made = assessment(secret, name, with_motor=with_motor)
        asked = [questions(made.exercise, made.stand(student.id)) for student in CLASS[:2]]
        same = same_for_all(asked)
        assert {
            q.blank.id for each in asked for q in each if q.is_answerable and not same[q.blank.id]
        } == expected


def test_the_frequency_response_is_asked_of_who_has_the_motor(secret: Path) -> None:
    """At a phase of -arctan(ωτ), moved forward by friction: below the linear one, above three quarters of it."""
    made = assessment(secret, "frequency_response", with_motor=True)
    _, tau, _ = physical(individual(SECRET, "frequency_response", "ada"))

    asked = {q.blank.id: q for q in questions(made.exercise, made.stand("ada"))}

    assert all(q.is_answerable for q in asked.values())
    assert 0.75 * tau < asked["by_phase"].right < tau
    assert asked["by_magnitude"].right == pytest.approx(
        tau, rel=0.1
    )  # what friction leaves of the corner, as the exercise says


# --- rosters


def roster(path: Path, content: str | bytes) -> Path:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_roster_is_read_in_its_order_as_spreadsheets_write_it(
    tmp_path: Path, encoding: str, separator: str
) -> None:
    lines = ["name,Student", "Émilie,z1", "", "Ada,a2", '"Noether, Emmy",m3']
    text = (
        "\r\n".join(lines)
        if separator == ","
        else "\r\n".join(line.replace('"Noether, Emmy"', "Emmy").replace(",", separator) for line in lines)
    )

    found = read_roster(roster(tmp_path / "r.csv", text.encode(encoding)))

    assert [student.id for student in found] == ["z1", "a2", "m3"]


def test_the_same_id_twice_is_reported_with_both_lines(tmp_path: Path) -> None:
    content = "student\nAda\nblaise\n ada \nBLAISE\n\u0041\u0308da\n\u00c4da\n"

    with pytest.raises(FormatError) as told:
        read_roster(roster(tmp_path / "r.csv", content))

    said = str(told.value).splitlines()
    assert len(said) == 3  # an Ä in one piece or in two is one letter
    assert re.search(r"r\.csv:4: 'ada' is the same as 'Ada' in line 2", said[0])
    assert re.search(r"r\.csv:5: 'BLAISE' is the same as 'blaise' in line 3", said[1])


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("ada\nblaise\n", "there is no column `student`"),
        ("student\n", "it has no students"),
        ("", "is empty"),
        ("student,x\n,1\n", r"r\.csv:2: '' isn't an id"),
        (b"PK\x03\x04rest", "save it as CSV"),
        (b"student\n\x00\x00", "is no text"),
    ],
)
def test_a_roster_that_can_t_be_read_is_reported(tmp_path: Path, content: str | bytes, said: str) -> None:
    with pytest.raises(FormatError, match=said):
        read_roster(roster(tmp_path / "r.csv", content))


def test_folders_stay_in_the_class_whatever_a_student_is_called(tmp_path: Path) -> None:
    names = ["../../etc", "CON", "a/b", "a\\b", "Émilie", "=1+1", ".hidden", "学生", "ok-1"]
    found = read_roster(roster(tmp_path / "r.csv", "student\n" + "\n".join(names)))

    folders = [student.folder for student in found]
    assert len({folder.casefold() for folder in folders}) == len(names)
    assert folders[-1] == "ok-1"
    for folder in folders:
        assert re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9._-]*", folder)
        assert folder != "CON"


# --- marks


def right_answers(made: Assessment, student: str) -> dict[str, str]:
    return {
        q.blank.id: f"{q.right:.6g} {q.blank.unit}".strip()
        for q in questions(made.exercise, made.stand(student))
    }


def fill(
    path: Path, answers: dict[str, str], code: str, separator: str = ",", encoding: str = "utf-8"
) -> None:
    text = io.StringIO()
    rows = [["blank", "answer"], *map(list, answers.items()), ["(code)", code]]
    csv.writer(text, delimiter=separator).writerows(rows)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text.getvalue().encode(encoding))


def marked(made: Assessment, folder: Path, students: tuple[Student, ...] = CLASS) -> tuple[StudentMarks, ...]:
    forms, _ = forms_in(folder)
    return mark(made, students, forms).students


def test_right_answers_get_their_points_and_a_neighbours_don_t(secret: Path, tmp_path: Path) -> None:
    made = assessment(secret)
    mine, neighbours = right_answers(made, "ada"), right_answers(made, "blaise")
    fill(tmp_path / "one" / "x.csv", mine, made.code("ada"))
    fill(tmp_path / "two" / "x.csv", mine, made.code("blaise"))

    ada, blaise, carl = marked(made, tmp_path)

    assert (ada.points, ada.total) == (6, 6)
    # What asks nothing of the motor is right for anybody; the rest is Ada's.
    assert {m.blank for m in blaise.marks if m.verdict == "right"} == {"level", "lag"}
    assert mine["gain"] != neighbours["gain"]
    assert (carl.points, carl.total, carl.notes) == (0, 6, ("There is no form.",))
    assert {m.verdict for m in carl.marks} == {"missing"}


def test_what_is_odd_gets_a_mark_and_a_reason(secret: Path, tmp_path: Path) -> None:
    made = assessment(secret)
    mine = right_answers(made, "ada")
    tau = float(mine["time_constant"].split()[0])
    answers = {
        "gain": f"{60 / (2 * math.pi) * float(mine['gain'].split()[0]):.6g}",  # a known mistake
        "read": "9" * 5000,
        "lag": "20 V",
        "time_constant": f"{1000 * tau:.6g}",  # ms without saying so
        "pole": '=HYPERLINK("http://x")',
        "colour": "blue",
    }
    fill(tmp_path / "x.csv", answers, made.code("ada"))

    (ada, *_) = marked(made, tmp_path)
    said = {m.blank: (m.verdict, m.sentence) for m in ada.marks}

    assert said["gain"][0] == "wrong"
    assert "revolutions per minute" in said["gain"][1]
    assert said["level"] == ("missing", "The form has no such line.")
    assert said["read"] == ("wrong", "An answer has 100 characters at most.")
    assert said["lag"][0] == "wrong"
    assert "voltage" in said["lag"][1]
    assert said["time_constant"][0] == "wrong"
    assert "10^3" in said["time_constant"][1]
    assert said["pole"][0] == "wrong"
    assert ada.notes == ("Answers to questions that weren't asked: 'colour'.",)
    assert max(len(m.given) for m in ada.marks) <= 101


@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_forms_are_read_as_spreadsheets_save_them(
    secret: Path, tmp_path: Path, encoding: str, separator: str
) -> None:
    """A semicolon or a tabulator between the cells goes with a comma in the numbers."""
    made = assessment(secret)
    answers = {name: text.replace(".", ",") for name, text in right_answers(made, "ada").items()}
    fill(tmp_path / "x.csv", answers, made.code("ada").upper(), separator=separator, encoding=encoding)

    (ada, *_) = marked(made, tmp_path)

    assert ada.points == ada.total == 6, ada


def test_a_decimal_comma_that_cuts_an_answer_in_two_is_noted(secret: Path, tmp_path: Path) -> None:
    """Typed into the form with a text editor, `19,9 ms` is two cells, of which the first, 19, could even be right."""
    made = assessment(secret)
    text = f"blank,answer,unit,what\nlag,19,9 ms,ms,Lag\nlevel,63.2,%,Height,,\n(code),{made.code('ada')},,\n"
    (tmp_path / "x.csv").write_text(text)

    (ada, *_) = marked(made, tmp_path)

    assert [note for note in ada.notes if "cell" in note] == [
        "x.csv:2: this row has 1 cell too many, so its answer may be only '19': was there a decimal comma? Write a point, "
        "and mark again."
    ]


def test_a_form_without_its_code_belongs_to_the_folder_that_it_lies_in(secret: Path, tmp_path: Path) -> None:
    made = assessment(secret)
    fill(tmp_path / "Carl" / "answers.csv", {"lag": "20 ms"}, "")
    fill(tmp_path / "ada.csv", {"lag": "21 s"}, "")
    fill(tmp_path / "dora" / "answers.csv", {"lag": "20 ms"}, "")
    fill(tmp_path / "x" / "answers.csv", {"lag": "20 ms"}, made.code("blaise"))

    forms, unread = forms_in(tmp_path)
    found = mark(made, CLASS, forms)

    assert unread == ()
    assert [each.points for each in found.students] == [0, 1, 1]
    assert len(found.stray) == 1
    assert "dora" in found.stray[0]


def test_two_forms_that_differ_count_for_nothing_until_somebody_chooses(secret: Path, tmp_path: Path) -> None:
    made = assessment(secret)
    for name, lag in (("a", "20 ms"), ("b", "25 ms")):
        fill(tmp_path / name / "answers.csv", {"lag": lag}, made.code("ada"))
        fill(tmp_path / name / "same.csv", {"lag": "20 ms"}, made.code("blaise"))

    ada, blaise, _ = marked(made, tmp_path)

    assert ada.points == 0
    assert "2 forms with different answers" in ada.notes[0]
    assert blaise.points == 1


def test_forms_of_another_secret_are_reported_before_anybody_gets_a_mark(
    secret: Path, tmp_path: Path
) -> None:
    made = assessment(secret)
    fill(tmp_path / "x.csv", {"lag": "20 ms"}, replace(made, secret=bytes(32)).code("ada"))

    with pytest.raises(UsageError, match="belong to another secret, exercise"):
        marked(made, tmp_path)


def test_what_can_t_be_read_is_reported_and_recordings_are_no_forms(
    secret: Path, tmp_path: Path, handed: tuple[Path, tuple[Handout, ...]]
) -> None:
    (tmp_path / "a.xlsx").write_bytes(b"PK\x03\x04")
    (tmp_path / "b.csv").write_bytes(b"blank,answer\n\x00")
    (tmp_path / "c.csv").write_text("t,u\n1,2\n", encoding="utf-8")

    forms, unread = forms_in(tmp_path)

    assert forms == ()
    assert ["a.xlsx" in unread[0], "b.csv" in unread[1], len(unread)] == [True, True, 2]
    assert [form.path.name for form in forms_in(handed[0])[0]] == [NAME] * 3


def test_marks_are_a_table_that_no_spreadsheet_computes(secret: Path, tmp_path: Path) -> None:
    names = ("=cmd|' /C calc'!A0", "+1", "-ada", "@SUM(1)", "\uff1d1", "ada")
    students = tuple(Student(id=name, folder=f"f{number}") for number, name in enumerate(names))
    made = assessment(secret, "encoder")
    fill(tmp_path / "f5.csv", {"wrap": "-10.1", "gain": "=1+1", "angle": "@x", "counts": "-2+3"}, "")
    forms, _ = forms_in(tmp_path)

    text = marks_table(mark(made, students, forms))
    rows = list(csv.DictReader(io.StringIO(text.removeprefix("\ufeff"))))

    assert [strip_apostrophe(row["student"]) for row in rows] == list(
        names
    )  # all of them, in the roster's order
    for row in rows:
        for cell in row.values():
            assert cell[:1] not in ("=", "+", "@", "\t", "\r", "\uff1d")
            assert not cell.startswith("-") or cell == "-10.1"
    assert rows[-1]["wrap: answer"] == "-10.1"
    assert (rows[-1]["points"], rows[-1]["of"]) == ("0", "6")


@pytest.mark.parametrize("text", ["=1", "'=1", "''=1", "-1e3", "- a", "+3", "@", "", "'", "it's", "a=b"])
def test_a_cell_comes_back_from_its_harmless_form(text: str) -> None:
    if text not in ("'=1", "''=1"):
        assert strip_apostrophe(harmless(text)) == text
    assert harmless(text)[:1] not in ("=", "@")


def test_a_table_survives_whatever_it_holds(tmp_path: Path) -> None:
    """Bytes at random, from a seed: a table, or a sentence."""
    random = np.random.default_rng(20261121)
    for number in range(300):
        content = b"blank,answer\n" + random.bytes(int(random.integers(0, 80)))
        path = roster(tmp_path / f"{number}.csv", content)
        try:
            said = ",".join(read_table(path).headings)
        except FormatError as error:
            said = str(error)
        assert said.startswith(("blank", str(path)))


def test_a_form_is_read_as_it_was_written(tmp_path: Path) -> None:
    blanks = exercise("identification").blanks
    (tmp_path / "f.csv").write_text(blank_form(blanks, "0" * 12), encoding="utf-8", newline="")

    form = read_form(tmp_path / "f.csv")

    assert form is not None
    assert list(form.answers) == [blank.id for blank in blanks]
    assert json.dumps(form.code) == '"000000000000"'


@pytest.mark.parametrize(("separator", "kept"), [(",", "1,5 s"), ("\t", "1.5 s"), (";", "1.5 s")])
def test_a_comma_is_a_decimal_mark_where_it_does_not_separate(
    tmp_path: Path, separator: str, kept: str
) -> None:
    with (tmp_path / "f.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, delimiter=separator).writerows([("blank", "answer"), ("tau", "1,5 s")])

    form = read_form(tmp_path / "f.csv")

    assert form is not None
    assert form.answers == {"tau": kept}


def asked(*right: float | None, allowed: float = 0.5) -> tuple[Question, ...]:
    """Questions with these right answers; None is a blank whose answer the recording doesn't show."""
    blank = Blank(id="one", label="", answer="1", tolerance="exact")
    return tuple(
        Question(blank=blank, why_not="nothing tells it")
        if value is None
        else Question(blank=blank, right=value, allowed=allowed)
        for value in right
    )


def test_a_blank_that_somebody_is_not_asked_keeps_no_form_apart() -> None:
    """The first two differ in what neither can be held to; the third is off in the last blank."""
    three = [asked(1.0, None, 5.0), asked(1.2, 7.0, 5.0), asked(1.2, 7.0, 9.0)]
    assert form_pass_rate(three[:2]) == 1.0
    assert form_pass_rate(three) == pytest.approx(2 / 6)  # of six ordered pairs
    assert math.isnan(form_pass_rate(three[:1]))


def test_points_are_out_of_what_was_asked() -> None:
    verdicts: tuple[Verdict, ...] = ("right", "wrong", "not asked", "missing")
    marks = tuple(Mark(blank=f"b{n}", verdict=each, given="", sentence="") for n, each in enumerate(verdicts))
    marked = StudentMarks(student="ada", marks=marks)

    assert (marked.points, marked.total) == (1, 3)
