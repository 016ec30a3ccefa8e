"""`servobench commission`: the acceptance test of a bench."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from datetime import UTC, date, datetime
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING, Annotated

import typer

from servobench.cli.failures import DEVICE_FAILED, DONE, INTERRUPTED
from servobench.cli.options import AsJson, VoltageLimit

if TYPE_CHECKING:
    from rich.console import Console

    from servobench.cli.progress import Progress
    from servobench.recordings.recording import Recording
    from servobench.rig.commission.acceptance import Acceptance, Checked
    from servobench.rig.commission.bench import Bench, Runner
    from servobench.rig.experiment import Experiment
    from servobench.rig.loop.run import Look

ALONE, TOGETHER = 20.0, 120.0
"""Time for somebody to turn the shaft: where nothing shows that it is done, and where Enter does [s]."""
_COLOURS = {"verified": "green", "failed": "bold red", "unsupported": "yellow", "unknown": "yellow"}


def commission(
    device: Annotated[str, typer.Argument(metavar="DEVICE", hidden=True)],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="The folder for recordings, commission.json and report.html; by default a new one named after the time.",
        ),
    ] = None,
    voltage_limit: VoltageLimit = None,
    turns: Annotated[
        float | None,
        typer.Option(
            metavar="N",
            help="Turn the shaft by hand this many times when asked; by default once in a terminal.",
        ),
    ] = None,
    until_wrap: Annotated[
        bool,
        typer.Option(
            "--until-wrap", help="Turn the motor until its counter wraps; it takes minutes for 24 bits."
        ),
    ] = False,
    signed_by: Annotated[
        str | None, typer.Option(metavar="NAME", help="Who signs off the acceptance.")
    ] = None,
    signed_on: Annotated[
        str | None,
        typer.Option(metavar="DATE", help="The day of the signature, such as 2026-11-23; by default today."),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Ask nothing, even in a terminal.")] = False,
    as_json: AsJson = False,
) -> None:
    """Find out whether a new bench is what it claims to be, before anything is measured on it.

    DEVICE is a name with settings, as for `run --device`: "rig:/dev/ttyUSB0 supply=9V". Each check is verified, failed,
    unsupported or unknown, and says what to do.

    Nothing spins until stopping is proved: 0 V, short pulses, the device's watchdog, then the rest, up to half of the range.
    Ctrl-C stops the motor and reports what was found so far. Exit status 4 if a check failed.
    """
    from servobench.cli.device_choice import device_choice
    from servobench.cli.experiment_choice import make_device
    from servobench.cli.output_folder import empty_folder
    from servobench.cli.progress import Progress, announce_compiling
    from servobench.cli.run import terminate_like_ctrl_c
    from servobench.cli.terminal import messages, output, print_json
    from servobench.core.errors import UsageError
    from servobench.rig.commission.acceptance import commission as carry_out
    from servobench.rig.commission.acceptance import sign_off
    from servobench.rig.commission.bench import Bench
    from servobench.rig.experiment import Experiment
    from servobench.rig.experiment.experiment import DeviceChoice

    signature = _signature(signed_by, signed_on)
    limit = _volts(voltage_limit)
    choice = device_choice(device, DeviceChoice(name="?"), 'in one text: "{} key=value"', option="")
    made = make_device(Experiment(device=choice), None)
    console = messages() if as_json else output()
    talks = _is_talking() and not (yes or as_json)
    now = datetime.now()
    if turns is not None and not 0 < turns <= 1000:
        raise UsageError(f"--turns {turns:g}: expected a number of turns above 0")
    if turns is not None and made.info.timing == "virtual":
        raise UsageError(f"--turns {turns:g}: nobody can turn the shaft of {made.info.name!r}; leave it out")
    with Progress() as progress, announce_compiling(progress), terminate_like_ctrl_c():
        person = None
        if made.info.timing != "virtual" and (talks or turns is not None):
            person = Hand(turns or 1.0, talks, progress)
        with empty_folder(out, "commission", now) as folder:
            bench = Bench(
                made,
                choice,
                _runner(folder, progress),
                limit=limit,
                person=person,
                until_wrap=until_wrap,
            )
            _announce(bench, console, progress, talks)
            acceptance = carry_out(
                bench,
                datetime.now(UTC).isoformat(timespec="seconds"),
                begin=lambda title: progress.begin(title),
                end=lambda checked: _show(console, progress, checked),
            )
            acceptance = _with_options(acceptance)
            if signature:
                acceptance = sign_off(acceptance, *signature)
            progress.begin("writing the report")
            _write(acceptance, bench, folder)
    _conclude(console, acceptance, folder)
    if as_json:
        print_json(acceptance.to_dict())
    raise typer.Exit(_status(acceptance))


class Hand:
    """A person who turns the shaft by hand on request; in a conversation Enter says that it is done."""

    def __init__(self, turns: float, talks: bool, progress: Progress) -> None:
        self.turns = turns
        self._talks = talks
        self._progress = progress

    def begin(self) -> tuple[float, Look | None]:
        """Ask for the turns."""
        from servobench.core.rounding import plain

        self._progress.begin("")
        often = "once" if self.turns == 1 else f"{plain(self.turns)} times"
        if not self._talks:
            self._progress.note(f"turn the shaft {often} by hand, one way, within the next {ALONE:g} s")
            return ALONE, None
        self._progress.note(
            f"make one mark on the shaft and one beside it; you will turn the shaft {often} by hand, one way, until the marks "
            "meet. Press Enter to begin"
        )
        sys.stdin.readline()
        self._progress.note(f"turn it {often} now, slowly, then press Enter")
        done = Event()

        def wait() -> None:
            sys.stdin.readline()
            done.set()

        Thread(target=wait, daemon=True).start()
        return TOGETHER, lambda _: "the shaft was turned" if done.is_set() else None


def _signature(name: str | None, day: str | None) -> tuple[str, str] | None:
    """The name that signs and the day; raises `UsageError` for a day that is none, or a day without a name."""
    from servobench.core.errors import UsageError

    if name is None:
        if day is not None:
            raise UsageError(f"--signed-on {day}: by whom? Give --signed-by as well")
        return None
    if not name.strip():
        raise UsageError("--signed-by is empty; expected a name")
    try:
        return name, (date.today() if day is None else date.fromisoformat(day)).isoformat()
    except ValueError:
        raise UsageError(f"--signed-on {day}: expected a day such as 2026-11-23") from None


def _volts(text: str | None) -> float | None:
    """The voltage in a text [V]."""
    from servobench.core.errors import UnitError, UsageError
    from servobench.core.units import quantity

    if text is None:
        return None
    try:
        return quantity(text, "V")
    except (UnitError, UsageError) as error:
        raise UsageError(f"--voltage-limit {text}: {error}") from None


def _is_talking() -> bool:
    """Whether somebody can read a question and answer it."""
    from servobench.cli.terminal import is_terminal

    return is_terminal(sys.stdin) and is_terminal(sys.stderr)


def _runner(folder: Path, progress: Progress) -> Runner:
    """The runner of the experiments, each recorded to a file of its own in the folder."""

    def carry_out(experiment: Experiment, name: str, look: Look | None) -> Recording:
        from servobench.cli.experiment_choice import make_device
        from servobench.cli.run import warn_of_danger
        from servobench.rig.loop.live import run_where_its_time_passes

        recording = run_where_its_time_passes(
            experiment,
            make_device(experiment, None),
            to=folder / f"{name}.mcap",
            look=look,
            alarm=progress.alarm,
        )
        warn_of_danger(recording, progress)
        return recording

    return carry_out


def _announce(bench: Bench, console: Console, progress: Progress, talks: bool) -> None:
    """Say what is going to happen, and let somebody who can answer begin it."""
    from servobench.cli.terminal import say
    from servobench.core.rounding import plain

    say(console, f"commissioning {bench.info.name}, with up to {plain(bench.limit)} V\n")
    if bench.info.timing == "virtual":
        return
    progress.note(
        "the motor will turn: keep clear, and keep a hand at the switch of its supply; Ctrl-C stops it"
    )
    if talks:
        progress.note("press Enter to begin")
        sys.stdin.readline()


def _show(console: Console, progress: Progress, checked: Checked) -> None:
    """Print a check: its state, what was found, and what to do about it."""
    from rich.text import Text

    from servobench.cli.layout import show_wrapped
    from servobench.cli.option_names import with_options

    progress.begin("")
    outcome = checked.outcome
    head = Text.assemble((f"{outcome.state:<12}", _COLOURS[outcome.state]), f"{checked.title:<26}")
    with progress.pause():
        show_wrapped(console, head, outcome.found, hanging=len(head))
        if outcome.remedy:
            show_wrapped(console, Text(" " * 14 + "→ "), with_options(outcome.remedy), hanging=16)


def _with_options(acceptance: Acceptance) -> Acceptance:
    """The same with options in place of keywords, for a reader at a command line."""
    from servobench.cli.option_names import with_options

    def with_option(checked: Checked) -> Checked:
        outcome = replace(checked.outcome, remedy=with_options(checked.outcome.remedy))
        return replace(checked, outcome=outcome)

    return replace(acceptance, checks=tuple(map(with_option, acceptance.checks)))


def _write(acceptance: Acceptance, bench: Bench, folder: Path) -> None:
    """Write the answer and the report; raises `StorageError`."""
    from servobench.core.errors import StorageError
    from servobench.report.commission import AcceptanceReport

    answer = folder / "commission.json"
    text = json.dumps(acceptance.to_dict(), indent=2, ensure_ascii=False, allow_nan=False)
    try:
        answer.write_text(text + "\n", encoding="utf-8", errors="backslashreplace", newline="\n")
    except OSError as error:
        raise StorageError(f"{answer} can't be written: {error.strerror or error}") from error
    AcceptanceReport(acceptance, bench.recordings).write(folder / "report.html")


def _conclude(console: Console, acceptance: Acceptance, folder: Path) -> None:
    from servobench.cli.terminal import say
    from servobench.report.commission import conclusion

    sentence = conclusion(acceptance)
    say(console, f"\n{sentence['word']}. {sentence['reason']}")
    say(console, f"report: {folder / 'report.html'}")


def _status(acceptance: Acceptance) -> int:
    if acceptance.interrupted:
        return INTERRUPTED
    return DEVICE_FAILED if acceptance.failed or acceptance.ended else DONE
