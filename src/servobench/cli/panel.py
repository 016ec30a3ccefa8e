"""`servobench panel`: the front panel, a page in the browser."""

from __future__ import annotations

import socket
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from servobench.cli.options import DeviceName

if TYPE_CHECKING:
    from servobench.panel.keys import Carrier
    from servobench.panel.server import Tls
    from servobench.rig.experiment import Experiment

_LOOPBACK = ("127.0.0.1", "::1", "localhost")
_EVERYWHERE = ("0.0.0.0", "::")


def panel(
    device: DeviceName = None,
    experiment: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="The experiment to start with: signal, controller, device, limits."
        ),
    ] = None,
    port: Annotated[
        int | None,
        typer.Option(metavar="N", min=0, max=65535, help="The port; by default 8765, or any free one."),
    ] = None,
    host: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="The address to listen on. Any but this machine's own (127.0.0.1) needs --tls-cert and --tls-key.",
        ),
    ] = "127.0.0.1",
    tls_cert: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The certificate (PEM) to serve https with.")
    ] = None,
    tls_key: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The certificate's private key (PEM).")
    ] = None,
    without_tls: Annotated[
        bool,
        typer.Option(
            "--without-tls",
            help=(
                "Listen on another address without TLS: anybody on the network can read the token and drive "
                "the motor."
            ),
        ),
    ] = False,
    folder: Annotated[
        Path,
        typer.Option(metavar="DIR", help="The folder of the recordings; created if missing."),
    ] = Path("recordings"),
    exercises: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="A folder with exercises of your own, instead of the built-in ones."
        ),
    ] = None,
    student: Annotated[
        str | None,
        typer.Option(
            "--assess",
            metavar="STUDENT",
            help="The motor that `lab assess` assigns to a student, by --secret and --exercise; its parameters stay hidden.",
        ),
    ] = None,
    secret: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The secret that the students' motors are drawn from."),
    ] = None,
    exercise: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help=("The exercise of --assess; a student's motor differs from exercise to exercise."),
        ),
    ] = None,
    open_browser: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the page in the browser.")
    ] = True,
    viewer: Annotated[
        bool,
        typer.Option("--viewer", help="Print a code for viewers, who may only watch and stop."),
    ] = False,
) -> None:
    """Drive the motor from a page in the browser: live scopes, recordings, results.

    Without --device and --experiment it uses the simulated motor. The printed link opens the panel once, within twelve
    hours, and each use prints a new one, so a link in a browser's history is useless. The motor turns only while the driving
    page is visible. Ctrl-C sets the voltage to zero and ends the panel; its last line says whether the device confirmed zero
    volts.
    """
    from servobench.cli.experiment_choice import choose_experiment, make_device
    from servobench.cli.terminal import messages, say
    from servobench.core.errors import UsageError

    _check_assessed(student, secret, exercise, device, experiment)
    tls = _tls(host, tls_cert, tls_key, without_tls)
    if exercises is not None and not exercises.is_dir():
        raise UsageError(f"--exercises {exercises} isn't a folder; expected one with exercises, NAME.md")
    try:
        from servobench.lab.exercise_file import FOLDER
        from servobench.panel.keys import Keys
        from servobench.panel.library import Library
        from servobench.panel.local_page import LocalPage
        from servobench.panel.pages import Panel
        from servobench.panel.server import door_for, listen, run
        from servobench.panel.session import MotorSession
    except ModuleNotFoundError as error:
        raise UsageError(
            f'the panel needs {error.name}, which isn\'t installed: pip install "servobench[panel]"'
        ) from None
    if student is None:
        chosen = choose_experiment(experiment, device, None, None)
    else:
        chosen = _student_experiment(student, secret, exercise, exercises or FOLDER)
    make_device(chosen, experiment)  # not entered: a mistake in its settings shows before anything is opened
    library, keys, local_page = Library(folder), Keys(used=lambda carrier: on_use(carrier)), LocalPage()
    library.prepare()
    with listen(host, port) as listener:
        scheme: Literal["http", "https"] = "http" if tls is None else "https"
        hosts = _names(host)
        door = door_for(hosts, listener.getsockname()[1], scheme, keys)
        base = f"{scheme}://{_host_text(hosts[0])}:{listener.getsockname()[1]}/"
        console = messages()

        def on_use(carrier: Carrier) -> None:
            if carrier == "local page":
                local_page.discard()
            else:
                say(console, f"for another browser: {base}?token={keys.new('operator')}")

        def on_begin() -> None:
            say(console, f"panel: {base}?token={keys.new('operator')}")
            if viewer:
                say(console, f"to watch and stop only: {base} with the code {keys.new('viewer', 'code')}")
            say(console, "Ctrl-C sets the voltage to zero and ends the panel.")
            if open_browser and _has_screen():
                key = keys.new("operator", "local page")
                local_page.open(
                    base, key, folder, lambda: say(console, "no browser has opened: open the link above.")
                )

        motor = MotorSession(chosen, library)
        try:
            with library.hold(base):
                run(
                    Panel(
                        motor=motor,
                        library=library,
                        door=door,
                        exercises=(exercises or FOLDER).resolve(),
                    ),
                    listener,
                    tls,
                    on_begin,
                    local_page.end,
                )
        except KeyboardInterrupt:
            say(console, f"\n{motor.last_word}")


def _check_assessed(
    student: str | None,
    secret: Path | None,
    exercise: str | None,
    device: str | None,
    experiment: Path | None,
) -> None:
    from servobench.core.errors import UsageError

    if student is None:
        for option, is_given in (("--secret", secret is not None), ("--exercise", exercise is not None)):
            if is_given:
                raise UsageError(f"{option} needs --assess STUDENT; give that as well")
        return
    if secret is None or exercise is None:
        raise UsageError(
            "--assess needs --secret FILE and --exercise NAME, as given to `servobench lab assess`: they determine the motor"
        )
    for option, is_given in (("--device", device is not None), ("--experiment", experiment is not None)):
        if is_given:
            raise UsageError(f"--assess and {option} don't go together; the exercise has both")


def _student_experiment(student: str, secret: Path | None, name: str | None, folder: Path) -> Experiment:
    """The exercise's experiment on the student's own motor; raises `UsageError` for an exercise that can't be assessed."""
    from servobench.lab.assessment.assigned_stand import Assessment, device_of_student
    from servobench.lab.exercise_file import exercise
    from servobench.rig.motor.secret import read_secret

    file = (secret or Path()).resolve()  # the loop is another process
    assessed = Assessment(exercise=exercise(name or "", folder), secret_file=file, secret=read_secret(file))
    device = device_of_student(student, assessed.exercise, file)
    return assessed.exercise.experiment.model_copy(update={"device": device})


def _tls(host: str, certificate: Path | None, key: Path | None, without: bool) -> Tls | None:
    """The certificate, None where there is none to be; raises `UsageError` for what isn't safe and wasn't requested."""
    from servobench.core.errors import UsageError

    if (certificate is None) != (key is None):
        raise UsageError("--tls-cert and --tls-key go together: give both, or none")
    for file in (certificate, key):
        if file is not None and not file.is_file():
            raise UsageError(f"{file}: there is no such file; give the certificate and its key as PEM files")
    if certificate is None or key is None:
        if host not in _LOOPBACK and not without:
            raise UsageError(
                f"--host {host}: others on the network could read the token and drive the motor. Give --tls-cert and "
                "--tls-key, or --without-tls if you trust everybody on that network"
            )
        return None
    from servobench.panel.server import Tls

    return Tls(certificate=certificate, key=key)


def _names(host: str) -> list[str]:
    """The names by which a browser may ask for a panel that listens there."""
    if host in _LOOPBACK:
        return ["127.0.0.1", "localhost"] if host != "::1" else ["::1", "localhost"]
    if host not in _EVERYWHERE:
        return [host]
    own = socket.gethostname()
    try:
        addresses = [str(each[4][0]) for each in socket.getaddrinfo(own, None, type=socket.SOCK_STREAM)]
    except OSError:  # a machine that doesn't know its own name
        addresses = []
    return list(dict.fromkeys([own, socket.getfqdn(), *addresses, "localhost", "127.0.0.1"]))


def _host_text(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def _has_screen() -> bool:
    """Whether there is a screen for a browser."""
    import os
    import sys

    return sys.platform in ("win32", "darwin") or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )
