"""Check that every public name says what it is: docstrings, errors, fields, shapes, units, sources.

Public is what no underscore hides. Everything is read from the source, nothing imported. Prints one line for each fault and
exits with status 1.

- Every module, class, function, method and property has a docstring; of the methods with two underscores on both sides those
  that one calls without noticing, `__call__` and `__getitem__`. An empty `__init__.py` says nothing and has to say nothing.
- An error of ours that is raised in the body of a function is named in its docstring or in that of its class, by itself or by
  an error that it is one of (`UnknownName` is a `UsageError`). What the making of an object raises is said of its class. Of
  commands docs/reference/commands.md says with which status they end; their docstrings are what `--help` prints.
- Every field of a class, which is each of its names with a type, has a docstring below it, or stands in that of the class:
  `sample_time`, or "the sample time"; or the kind's `base.py` says it for all members.
- A parameter or a result that is an `Array` has its shape told, such as `(N,)`, in the docstring of the function or the class,
  or in that of the method of the same name in the kind's `base.py`; in `kernels`, whose functions share their arguments, in
  that of the module.
- A float that is a quantity by its name (`voltage`, `sample_time`, ...) has a unit there: in square brackets, or as a word.

In the folders of methods (`LAWS`) and in the modules beside them:

- A module whose public docstrings hold a formula says in one of them where it comes from; in `METHODS`, where each file is a
  method, with or without a formula. What a folder's `base.py` asks of its members is no law. A source is one of these:
  an author with a year, "Van Loan 1978"; a standard, "JCGM 101:2008"; "section II.D of the paper" that this project starts from;
  a record or page of ours that is there, "docs/decisions/0006-intervals.md"; "by definition", "by algebra" or "follows from",
  in a docstring that holds the formula, too; or "source: see `systems.filters.response`", a module that has one itself.
"""

import ast
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

EXAMPLE = re.compile(r"^(?:>>>|\.\.\. ).*$", re.MULTILINE)
ROOT = Path(__file__).resolve().parent.parent
SOURCE = ROOT / "src" / "servobench"
COMMANDS = "cli"  # the folder
KERNELS = "kernels.py"  # functions that share their arguments
OPERATORS = {"__call__", "__getitem__"}
SHAPE = re.compile(
    r"\([A-Z][^()]*,[^()]*\)|\([a-z](?: \+ 1)?,\)|\b[Ss]hape\b|\([0-9]+, ?[A-Z0-9]+\)|scalar|\([0-9]+,\)"
)
UNIT = re.compile(
    r"\[[^\]]+\]|\bseconds?\b|\bvolts?\b|\bradians?\b|\bHz\b|\brad/s\b|\bSI\b|\bunits?\b|\bfraction\b|\bfactor\b|\brelative\b|"
    r"\bin (s|V|A|rad|m|ms|%)\b"
)
QUANTITIES = {
    "t", "time", "voltage", "sample_time", "duration", "delay", "frequency", "cutoff", "speed", "position", "angle", "current",
    "resistance", "inductance", "inertia", "torque", "start", "end", "dt", "h", "tau", "omega", "timeout", "period", "reference",
}  # fmt: skip

METHODS = {
    "identification/estimators", "systems/filters", "systems/stability", "systems/tuning", "rig/motor/solvers"
}  # fmt: skip
LAWS = METHODS | {
    "core", "systems", "systems/control", "systems/signals", "recordings", "recordings/measurement", "rig", "rig/motor",
    "identification", "identification/choice", "identification/choice/rungs", "identification/design",
    "identification/estimators/instruments", "identification/estimators/interval", "identification/estimators/recursion",
    "identification/estimators/spectral", "identification/honest", "identification/models", "identification/models/nonlinear",
    "identification/models/position_loop", "identification/models/rational", "identification/models/second_order",
    "identification/motor_parameters", "identification/reconciliation", "identification/reconciliation/causes",
    "identification/trust", "identification/trust/doubts", "identification/trust/explanations",
    "identification/uncertainty", "export", "lab", "lab/studies",
}  # fmt: skip
FORMULA = re.compile(r"[^\W_]\S* = [^,;:]{0,60}?[+·/√^²∫Σ|(-]|√(?!Hz)|Σ(?!Q)|[∫≈]")
_AUTHOR = (
    r"[A-ZÅÄÖ][^\W\d_]+(?:-[A-Z][^\W\d_]+)*(?:'s [a-z]+(?: [a-z]+)?)?"  # "Schwarz's criterion (1978)", too
)
_YEAR = r"(?:1[6-9]\d\d|20[0-2]\d)\b(?! (?:counts|samples|points|lines|steps|times))"
SOURCES = re.compile(
    rf"\b{_AUTHOR}(?:,? and {_AUTHOR}|, {_AUTHOR})*(?: et al\.)?(?:, [A-Z][^;:()=]{{0,70}},?)? \(?{_YEAR}"
    r"|\b(?:ISO|IEC|IEEE|DIN|JCGM|RFC) \d+"
    r"|\b(?:[Ss]ection|[Tt]able|[Ee]xercise|[Ee]quations?) [IVX\d][\w.-]* of the paper\b"
)
DERIVED = re.compile(r"\b[Bb]y (?:definition|algebra)\b|\b[Ff]ollows? from\b")
PAGE = re.compile(r"\bdocs/[\w/-]+\.md\b")
SEE = re.compile(r"\b[Ss]ources?: see `([\w.]+)`")


@dataclass
class Told:
    """The docstrings in which a name may be explained: those around it, and those of the kind's base."""

    file: str
    path: str = ""
    around: str = ""
    base: dict[str, str] = field(default_factory=dict)


def problems(source: Path = SOURCE) -> list[str]:
    """Return one line for each public name below `source` that doesn't say what it should."""
    files = [file for file in sorted(source.rglob("*.py")) if _is_public(file, source)]
    return [fault for file in files for fault in of_file(file, source)]


def of_file(file: Path, source: Path = SOURCE) -> Iterator[str]:
    """Yield one line for each fault in a module."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    base = _said_in_base(
        next((each for each in _bases(file, source) if each.exists()), file.parent / "base.py")
    )
    shared = ast.get_docstring(tree) or "" if file.name == KERNELS else ""
    told = Told(file=file.relative_to(source.parent).as_posix(), around=shared, base=base)
    if tree.body and not ast.get_docstring(tree):
        yield f"{told.file}:1: the module has no docstring"
    if _states_a_law(file, tree, source) and not has_source(tree, source):
        yield f"{told.file}:1: nothing says where the law or method comes from; expected an author and a year, or a derivation"
    yield from _members(tree.body, told)


def has_source(tree: ast.Module, source: Path = SOURCE) -> bool:
    """Return whether a module names a source, or another module that does."""
    docstrings = _public_docstrings(tree)
    if any(_names_source(text) for text in docstrings):
        return True
    for name in SEE.findall(" ".join(docstrings)):
        path = f"{name.replace('.', '/')}.py"  # from the package, or within one of its rooms
        for file in (source / path, *source.glob(f"*/{path}")):
            if file.exists() and any(
                map(_names_source, _public_docstrings(ast.parse(file.read_text(encoding="utf-8"))))
            ):
                return True
    return False


def _names_source(text: str) -> bool:
    derived = bool(DERIVED.search(text) and FORMULA.search(text))
    return derived or bool(SOURCES.search(text)) or any((ROOT / page).exists() for page in PAGE.findall(text))


def _states_a_law(file: Path, tree: ast.Module, source: Path) -> bool:
    folder = file.parent.relative_to(source).as_posix().removeprefix(".")
    if file.name in {"__init__.py", "base.py"} or folder not in LAWS:
        return False
    return folder in METHODS or any(FORMULA.search(text) for text in _public_docstrings(tree))


def _public_docstrings(tree: ast.Module) -> list[str]:
    """The docstrings of a module, its public classes and their public members, each in one line and without examples."""

    def inside(node: ast.Module | ast.ClassDef) -> Iterator[str]:
        yield ast.get_docstring(node) or ""
        for inner in node.body:
            if isinstance(inner, ast.ClassDef) and not inner.name.startswith("_"):
                yield from inside(inner)
            elif isinstance(inner, ast.FunctionDef | ast.AsyncFunctionDef) and _speaks(inner):
                yield ast.get_docstring(inner) or ""

    return [" ".join(re.sub(EXAMPLE, "", text).split()) for text in inside(tree)]


def _is_public(file: Path, source: Path) -> bool:
    return not any(part.startswith("_") and part != "__init__.py" for part in file.relative_to(source).parts)


def _bases(file: Path, source: Path) -> Iterator[Path]:
    """Places for the base module of a kind: beside a file, or in a folder above it."""
    folder = file.parent
    while folder != source:
        yield folder / "base.py"
        folder = folder.parent


@cache
def _said_in_base(file: Path) -> dict[str, str]:
    """The docstrings of methods and fields in a kind's base module, by name, with those of their classes."""
    if not file.exists():
        return {}
    found: dict[str, str] = {}
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ClassDef):
            whole = ast.get_docstring(node) or ""
            protocol = any(ast.unparse(each).startswith("Protocol") for each in node.bases)
            for inner, below in zip(node.body, [*node.body[1:], None], strict=True):
                if isinstance(inner, ast.FunctionDef):
                    text = f"{whole} {ast.get_docstring(inner) or ''}"
                    found[inner.name] = f"{found.get(inner.name, '')} {text}"
                elif protocol and isinstance(inner, ast.AnnAssign):
                    name = ast.unparse(inner.target)
                    if _is_text(below) or _names(whole, name):
                        found[name] = whole
    return found


def _is_text(node: ast.stmt | None) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _names(text: str, name: str) -> bool:
    """Whether a text mentions a field by its name, or by the words in it: `sample_time`, "the sample time"."""
    words = re.escape(name.rstrip("_")).replace("_", "[ _-]")
    return re.search(rf"\b{words}", text, re.IGNORECASE) is not None


def _members(body: list[ast.stmt], told: Told) -> Iterator[str]:
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from _class(node, told)
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and _speaks(node):
            yield from _function(node, told)
        elif isinstance(node, ast.If | ast.Try):
            yield from _members(node.body, told)


def _speaks(node: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Whether a function needs a docstring: a public one that is no overload and no setter."""
    if any(ast.unparse(mark).endswith((".setter", ".deleter", "overload")) for mark in node.decorator_list):
        return False
    return node.name in OPERATORS or not node.name.startswith("_")


def _class(node: ast.ClassDef, told: Told) -> Iterator[str]:
    where = f"{told.file}:{node.lineno}: {told.path}{node.name}"
    text = ast.get_docstring(node) or ""
    if not text:
        yield f"{where} has no docstring"
    inside = replace(told, path=f"{told.path}{node.name}.", around=f"{told.around} {text}")
    yield from _fields(node, inside)
    yield from _members(node.body, inside)
    for made in node.body:  # what making one raises is said of the class
        if isinstance(made, ast.FunctionDef) and made.name in {"__init__", "__post_init__"}:
            yield from _errors(made, f"{text} {ast.get_docstring(made) or ''}", where)


def _fields(node: ast.ClassDef, told: Told) -> Iterator[str]:
    for at, statement in enumerate(node.body):
        if not isinstance(statement, ast.AnnAssign) or not isinstance(statement.target, ast.Name):
            continue
        name = statement.target.id
        described = _is_text(node.body[at + 1]) if at + 1 < len(node.body) else False
        if name.startswith("_") or described or name in told.base or _names(told.around, name):
            continue
        yield f"{told.file}:{statement.lineno}: {told.path}{name}: nothing says what this field is"


def _function(node: ast.FunctionDef | ast.AsyncFunctionDef, told: Told) -> Iterator[str]:
    where = f"{told.file}:{node.lineno}: {told.path}{node.name}"
    text = ast.get_docstring(node) or ""
    if not text:
        yield f"{where} has no docstring"
        return
    said = f"{text} {told.around} {told.base.get(node.name, '') if told.path else ''}"
    yield from _errors(node, said, where)
    yield from _shapes(node, said, where)
    yield from _units(node, said, where)


def _errors(node: ast.FunctionDef | ast.AsyncFunctionDef, said: str, where: str) -> Iterator[str]:
    if f"/{COMMANDS}/" in where.partition(":")[0]:
        return
    ours = errors_of(SOURCE)
    for name in sorted({*_raised(node.body)} & {*ours}):
        known = {name, *ours[name]}
        if not any(re.search(rf"\b{each}", said) for each in known):
            yield f"{where} raises {name}, and its docstring doesn't say so"


def _raised(body: list[ast.stmt]) -> Iterator[str]:
    """The names of the errors that are raised in these statements, functions within them left out."""
    for statement in body:
        if isinstance(statement, ast.FunctionDef | ast.ClassDef):
            continue
        if isinstance(statement, ast.Raise) and isinstance(statement.exc, ast.Call):
            yield ast.unparse(statement.exc.func).rpartition(".")[2]
        for inner in ("body", "orelse", "finalbody"):
            yield from _raised(getattr(statement, inner, []))
        for handler in getattr(statement, "handlers", []):
            yield from _raised(handler.body)
        for case in getattr(statement, "cases", []):
            yield from _raised(case.body)


@cache
def errors_of(source: Path) -> dict[str, set[str]]:
    """Return the public exceptions that a package defines, with those of them, but for the root of all, that each is one of."""
    bases = {
        node.name: {ast.unparse(base) for base in node.bases}
        for file in source.rglob("*.py")
        for node in ast.parse(file.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef)
    }
    above = {name: _ancestors(name, bases) for name in bases}
    ours = {name for name in bases if "Exception" in above[name] and not name.startswith("_")}
    return {name: above[name] & ours - {"ServobenchError"} for name in ours}


def _ancestors(name: str, bases: dict[str, set[str]]) -> set[str]:
    own = bases.get(name, set())
    return own.union(*(_ancestors(base, bases) for base in own))


def _shapes(node: ast.FunctionDef | ast.AsyncFunctionDef, said: str, where: str) -> Iterator[str]:
    arrays = [each.arg for each in _arguments(node) if each.annotation and _is_array(each.annotation)]
    back = node.returns is not None and _is_array(node.returns)
    if (arrays or back) and not SHAPE.search(said):
        yield f"{where}: no shape is told of {', '.join(arrays + ['the result'] * back)}; expected such as (N,)"


def _units(node: ast.FunctionDef | ast.AsyncFunctionDef, said: str, where: str) -> Iterator[str]:
    quantities = [
        each.arg
        for each in _arguments(node)
        if each.arg in QUANTITIES
        and each.annotation
        and re.match(r"(float|Array)\b", ast.unparse(each.annotation))
    ]
    if quantities and not UNIT.search(said):
        yield f"{where}: no unit is told of {', '.join(quantities)}; expected such as [s]"


def _arguments(node: ast.FunctionDef | ast.AsyncFunctionDef) -> list[ast.arg]:
    return [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]


def _is_array(annotation: ast.expr) -> bool:
    return re.match(r"(Array|NDArray)\b", ast.unparse(annotation)) is not None


if __name__ == "__main__":
    found = problems()
    print("\n".join(found), end="\n" if found else "")
    sys.exit(1 if found else 0)
