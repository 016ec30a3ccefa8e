"""`servobench completion`: shell completion of commands, options and names."""

from __future__ import annotations

from typing import Annotated, Any

import typer


def completion(
    context: typer.Context,
    shell: Annotated[str, typer.Argument(metavar="bash|zsh|fish|powershell", hidden=True)],
) -> None:
    """Print a script that makes a shell complete commands, options and names.

    In the shell's start-up file, for bash: source <(servobench completion bash); for zsh the same with zsh, behind compinit;
    for fish: servobench completion fish | source; for PowerShell: servobench completion powershell | Out-String |
    Invoke-Expression.
    """
    from servobench.cli.terminal import print_text
    from servobench.core.errors import UnknownName

    makers = {"bash": _bash, "zsh": _zsh, "fish": _fish, "powershell": _powershell}
    if shell not in makers:
        raise UnknownName("shell", shell, makers)
    print_text(makers[shell](_words(context.find_root().command)))


def _words(application: Any) -> dict[str, list[str]]:
    """Possible continuations: options and subcommands by command, names by command and option."""
    known: dict[str, list[str]] = {}

    def look(command: Any, words: str) -> None:
        inner = getattr(command, "commands", {})
        options = [option for each in command.params for option in each.opts if option.startswith("--")]
        known[words] = sorted([*inner, *options, "--help"])
        for name, each in inner.items():
            look(each, f"{words} {name}".strip())
        for kind, option in _OPTIONS.items():
            if option in options:
                known[f"{words} {option}"] = _names(kind, words)
        if words in _LISTS:
            known[words] = sorted([*known[words], *_names(words, words)])

    look(application, "")
    return known


_OPTIONS = {
    "structures": "--structure",
    "estimators": "--estimator",
    "devices": "--device",
    "exports": "--as",
    "data sheets": "--nominal",
}
_LISTS = (
    "signals",
    "controllers",
    "devices",
    "faults",
    "structures",
    "estimators",
    "formats",
    "exports",
    "studies",
)


def _names(kind: str, command: str) -> list[str]:
    """The names of a kind that can be typed."""
    from servobench.export.base import TARGETS
    from servobench.identification.estimators.base import ESTIMATORS
    from servobench.identification.models.base import STRUCTURES
    from servobench.lab.studies.base import STUDIES
    from servobench.recordings.formats.base import FORMATS
    from servobench.rig.devices.base import DEVICES
    from servobench.rig.devices.faults.base import FAULTS
    from servobench.rig.motor.parameters import DATA_SHEETS
    from servobench.systems.control.base import CONTROLLERS
    from servobench.systems.signals.base import SIGNALS

    kinds: dict[str, Any] = {
        "signals": SIGNALS,
        "controllers": CONTROLLERS,
        "devices": DEVICES,
        "faults": FAULTS,
        "structures": STRUCTURES,
        "estimators": ESTIMATORS,
        "formats": FORMATS,
        "exports": TARGETS,
        "studies": STUDIES,
    }
    if kind == "data sheets":
        return sorted(DATA_SHEETS)
    if kind == "exports" and command == "tune":
        return [name for name in CONTROLLERS.names() if name != "open_loop"]
    return list(kinds[kind].names())


def _cases(known: dict[str, list[str]]) -> list[tuple[str, str]]:
    return [(words, " ".join(names)) for words, names in sorted(known.items())]


def _bash(known: dict[str, list[str]]) -> str:
    cases = "\n".join(f'        "{words}") names="{names}" ;;' for words, names in _cases(known))
    groups = "|".join(sorted({words.split()[0] for words in known if _is_of_group(words)}))
    return f"""# Completion of servobench for bash.
_servobench() {{
    local word="${{COMP_WORDS[COMP_CWORD]}}" before="${{COMP_WORDS[COMP_CWORD-1]}}" command="" names=""
    if [ "$COMP_CWORD" -gt 1 ]; then
        command="${{COMP_WORDS[1]}}"
        case "$command" in {groups}) [ "$COMP_CWORD" -gt 2 ] && command="$command ${{COMP_WORDS[2]}}" ;; esac
    fi
    _servobench_names "$command $before"
    [ -n "$names" ] || _servobench_names "$command"
    COMPREPLY=( $(compgen -W "$names" -- "$word") )
    case "$word" in -*) ;; *) [ "$COMP_CWORD" -gt 1 ] && COMPREPLY+=( $(compgen -f -- "$word") ) ;; esac
}}
_servobench_names() {{
    names=""
    case "$1" in
{cases}
    esac
}}
complete -o filenames -F _servobench servobench
"""


def _zsh(known: dict[str, list[str]]) -> str:
    return f"autoload -U +X bashcompinit && bashcompinit\n{_bash(known)}"


def _is_of_group(words: str) -> bool:
    """Whether the words name a command of a group."""
    return len(words.split()) == 2 and not words.split()[1].startswith("-")


def _fish(known: dict[str, list[str]]) -> str:
    lines = ["# Completion of servobench for fish.", "complete -c servobench -e"]
    for words, names in _cases(known):
        *commands, last = words.split() or [""]
        if last.startswith("-"):
            when = f"__fish_seen_subcommand_from {commands[-1]}" if commands else "true"
            lines.append(f"complete -c servobench -n '{when}' -l {last[2:]} -x -a '{names}'")
            continue
        when = f"__fish_seen_subcommand_from {last}" if last else "__fish_use_subcommand"
        for name in names.split():
            if f"{words} {name}".strip() in known and name.startswith("--"):
                continue
            what = f"-l {name[2:]}" if name.startswith("--") else f"-a {name}"
            lines.append(f"complete -c servobench -n '{when}' {what}")
    return "\n".join(lines) + "\n"


def _powershell(known: dict[str, list[str]]) -> str:
    table = "\n".join(f"    '{words}' = '{names}'" for words, names in _cases(known))
    return f"""# Completion of servobench for PowerShell.
$servobenchNames = @{{
{table}
}}
Register-ArgumentCompleter -Native -CommandName servobench -ScriptBlock {{
    param($word, $line, $position)
    $typed = @($line.CommandElements | Where-Object {{ $_.Extent.EndOffset -lt $position }} | ForEach-Object {{ $_.ToString() }})
    $command = ''
    if ($typed.Count -gt 1) {{ $command = $typed[1] }}
    if ($typed.Count -gt 2 -and $servobenchNames.ContainsKey("$command $($typed[2])")) {{
        if (-not $typed[2].StartsWith('-')) {{ $command = "$command $($typed[2])" }}
    }}
    $names = $servobenchNames["$command $($typed[-1])"]
    if (-not $names) {{ $names = $servobenchNames[$command] }}
    if ($names) {{
        $names.Split(' ') | Where-Object {{ $_.StartsWith($word) }} | ForEach-Object {{
            [System.Management.Automation.CompletionResult]::new($_, $_, 'ParameterValue', $_)
        }}
    }}
}}
"""
