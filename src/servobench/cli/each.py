"""`servobench identify --each`: many files, each by itself; a file that can't be used doesn't stop the others."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from servobench.cli.failures import DONE, REFUSED, USER_MISTAKE
from servobench.cli.option_names import with_options

if TYPE_CHECKING:
    from servobench.fleet.settings import Settings
    from servobench.identification.result import Result
    from servobench.recordings.evidence import Evidence

SCHEMA = "servobench.each/1"
_IN_A_LINE = ("gain", "time_constant")


def identify_each(
    files: Sequence[Path], settings: Settings, out: Path | None, as_json: bool, command: str
) -> int:
    """Identify each file by itself, and return the exit status.

    With `out` each has a folder of its file's name, with result and report; with `as_json` a line on standard output. The status
    is that of the worst: 2 where a file couldn't be used, 3 where one was refused, 0 otherwise.
    """
    from servobench.cli.failures import PartialStop
    from servobench.cli.output_folder import empty_folder
    from servobench.cli.progress import Progress, announce_compiling
    from servobench.core.rounding import count_text

    statuses, first_of = [], dict[str, Path]()
    names = _names_of_their_own(files)
    with (
        empty_folder(out, "identify", datetime.now()) if out is not None else nullcontext() as folder,
        Progress() as progress,
        announce_compiling(progress),
    ):
        for number, (file, name) in enumerate(zip(files, names, strict=True)):
            progress.begin(f"identifying {count_text(len(files), 'file')}")
            progress.advance(number / len(files))
            place = folder / name if folder is not None else None
            try:
                statuses.append(_identify_one(file, settings, place, as_json, command, first_of))
            except KeyboardInterrupt:
                raise PartialStop(
                    f"interrupted: {number} of {count_text(len(files), 'file')} done, {file} was next; what was printed and "
                    "written is whole"
                ) from None
    return next((status for status in (USER_MISTAKE, REFUSED) if status in statuses), DONE)


def _identify_one(
    file: Path,
    settings: Settings,
    folder: Path | None,
    as_json: bool,
    command: str,
    first_of: dict[str, Path],
) -> int:
    """The exit status of one file, whose result or error is printed and written; `first_of` has the first of equal files."""
    from servobench.cli.conclusion import status_of
    from servobench.cli.failures import complain
    from servobench.cli.terminal import output, say
    from servobench.core.errors import MissingInformation, ServobenchError

    try:
        evidence, result = settings.identify(file)
    except ServobenchError as error:
        if error.exit_status != USER_MISTAKE:
            raise
        reason = "; ".join(error.missing) if isinstance(error, MissingInformation) else str(error)
        sentence = with_options(reason)
        complain(f"{file}: {sentence}")
        if as_json:
            _print_line(file, sentence, None)
        return error.exit_status
    if folder is not None:
        _write(folder, evidence, result, command)
    if as_json:
        _print_line(file, None, result.to_dict())
    else:
        checksum = evidence[0].recording.source.sha256
        copy = f"; a copy of {first_of[checksum]}" if checksum in first_of else ""
        first_of.setdefault(checksum, file)
        say(output(), f"{file}: {_in_a_line(result)}{copy}")
    return status_of(result)


def _print_line(file: Path, error: str | None, result: Mapping[str, Any] | None) -> None:
    """Print what came of a file as one line of JSON."""
    from servobench.cli.terminal import print_text

    line = {"schema": SCHEMA, "file": str(file), "error": error, "result": result}
    print_text(json.dumps(line, allow_nan=False) + "\n")


def _write(folder: Path, evidence: Sequence[Evidence], result: Result, command: str) -> None:
    """Write the result of a file and its report into its folder."""
    from servobench.cli.output_folder import make
    from servobench.cli.run_folder import RunFolder
    from servobench.report.document import Report

    with TemporaryDirectory(prefix=".", dir=folder.parent) as temporary:
        whole = RunFolder(Path(temporary) / folder.name)
        make(whole.path)
        whole.write_result(result.to_dict())
        Report([part.recording for part in evidence], result, command=command).write(whole.report)
        whole.path.replace(folder)


def _in_a_line(result: Result) -> str:
    """The verdict and the parameters with their intervals, or why there are none."""
    from servobench.core.finding import Severity
    from servobench.core.parameter_names import parameter_in_words

    parts: list[Any] = [str(result.verdict)]
    if result.verdict == "refused" or result.fit is None:
        reasons = [
            with_options(each.sentence) for each in result.findings if each.severity is Severity.REFUSAL
        ]
        return "; ".join([*parts, *reasons[:1]])
    names = [
        parameter_in_words(name, estimate.unit)
        for name, estimate in result.fit.estimates.items()
        if name in _IN_A_LINE
    ]
    names += [each.meaning for each in result.combinations]
    return ", ".join([*parts, *(f"{name} {value}" for name, value in result.answer_rows() if name in names)])


def _names_of_their_own(files: Sequence[Path]) -> list[str]:
    """The names of the files without endings, with a number where several have one name."""
    stems = [file.stem for file in files]
    return [
        stem if stems.count(stem) == 1 else f"{stem}-{stems[: place + 1].count(stem)}"
        for place, stem in enumerate(stems)
    ]
