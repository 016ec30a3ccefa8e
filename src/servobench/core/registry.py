"""A kind and its members: the files in the kind's folder, and plug-ins by their entry points."""

from __future__ import annotations

import importlib
import pkgutil
import re
import sys
from collections.abc import Callable, Iterator
from functools import cache
from importlib.metadata import entry_points
from importlib.util import find_spec
from types import FunctionType
from typing import Any, Generic, TypeVar

from servobench.core.errors import UnknownName, UsageError

T = TypeVar("T")
_KERNELS = "kernels"


class Registry(Generic[T]):
    """The members of one kind by name.

    `kind` is the singular noun that error messages use; `package` is the folder. A module is imported when the member of its
    name is first requested, and all are for any other question, so that defining a kind costs nothing at start-up. Members of
    other packages come from the entry-point `group`, which is named like the folder unless it says otherwise: a folder may move,
    a group may not.
    """

    def __init__(self, kind: str, package: str, group: str | None = None) -> None:
        self.kind = kind
        self.package = package
        self.group = group or package
        self._members: dict[str, T] = {}
        self._families: dict[str, Callable[[str], T | None]] = {}
        self._meanings: dict[str, str] = {}
        self._made: dict[str, T] = {}
        self._complete = False

    def member(self, name: str) -> Callable[[T], T]:
        """Return a decorator that makes what it decorates the member of that name.

        Raises `UsageError` where two members claim one name.
        """

        def add(member: T) -> T:
            if name in self._members and self._members[name] is not member:
                raise UsageError(f"two members of {self.group} are called {name!r}: rename one of them")
            self._members[name] = member
            return member

        return add

    def family(self, form: str, make: Callable[[str], T | None], meaning: str) -> None:
        """Add members without number that are made from their names.

        `form` shows such a name, `make` returns None for others, and `meaning` explains the form's parts to who got one wrong.
        """
        self._families[form] = make
        self._meanings[form] = meaning

    def names(self) -> tuple[str, ...]:
        """Return the names of all members, sorted."""
        self._load()
        return tuple(sorted(self._members))

    def __getitem__(self, name: str) -> T:
        """Return the member of that name, fixed or of a family; raises `UnknownName`, which lists the known ones."""
        if isinstance(name, str) and self._has_at_home(name):
            return self._members[name]
        self._load()
        if not isinstance(name, str):
            raise UnknownName(self.kind, name, self._members)
        if name in self._members:
            return self._members[name]
        for make in self._families.values():
            made = self._made.get(name) or make(name)
            if made is not None:
                return self._made.setdefault(name, made)
        # A form begins with letters that all its names have, up to its first choice or capital.
        meant = [form for form in self._families if name.startswith(_prefix(form))]
        explained = "".join(f"; {form}: {self._meanings[form]}" for form in meant)
        raise UnknownName(self.kind, name, [*self._members, *self._families], explained)

    def __contains__(self, name: object) -> bool:
        """Return whether there is a member of that name, fixed or of a family."""
        try:
            return isinstance(name, str) and self[name] is not None
        except UnknownName:
            return False

    def __len__(self) -> int:
        return len(self.names())

    def __iter__(self) -> Iterator[T]:
        return (self._members[name] for name in self.names())

    def families(self) -> dict[str, str]:
        """Return the forms of the names of members without number, and what their parts mean."""
        self._load()
        return dict(self._meanings)

    def sentence(self, name: str) -> str:
        """Return what a member is, in a sentence: the first line of its file, or its own where a file has several members."""
        member = self[name]
        home = _home(member)
        alone = [_home(each) for each in self].count(home) == 1
        own = member if isinstance(member, type | FunctionType) else type(member)
        docstring = (sys.modules[home].__doc__ if alone else None) or own.__doc__ or ""
        return (docstring.strip().splitlines() or [""])[0]

    def __repr__(self) -> str:
        """The members, a line for each: what it is."""
        names = self.names()
        widest = max(map(len, names), default=0)
        lines = [f"{name:{widest}}  {self.sentence(name)}" for name in names]
        return "\n".join([*lines, *(f"{form}: {meaning}" for form, meaning in self._meanings.items())])

    def _ipython_key_completions_(self) -> list[str]:
        """The names that a notebook completes between the brackets."""
        return list(self.names())

    def name_of(self, candidate: object) -> str:
        """Return the name that a member, or a value whose class is a member, is known by.

        Raises `UsageError` where it is no member of this kind.
        """
        self._load()
        for name, member in {**self._members, **self._made}.items():
            if candidate is member or type(candidate) is member:
                return name
        raise UsageError(f"{candidate!r} isn't a known {self.kind}; known: {', '.join(self.names())}")

    def _has_at_home(self, name: str) -> bool:
        """Whether a member is known, or becomes known by importing the file that is named like it: the others aren't needed."""
        if not self._complete and name not in self._members and name.isidentifier() and name != _KERNELS:
            module = f"{self.package}.{name}"
            if find_spec(module) is not None:
                importlib.import_module(module)
        return name in self._members

    def _load(self) -> None:
        if self._complete:
            return
        self._complete = True  # before the work: a member's module may ask for another member
        try:
            self._import_all()
        except BaseException:
            self._complete = False  # or the next look would find a part of the members and call it all
            raise

    def _import_all(self) -> None:
        folder = importlib.import_module(self.package)
        for module in pkgutil.iter_modules(folder.__path__):
            # Compiled kernels belong to members and are none; importing them costs a second that a look at the names shouldn't.
            if module.name != _KERNELS:
                importlib.import_module(f"{self.package}.{module.name}")
        for plug_in in _plug_ins().select(group=self.group):
            try:
                member = plug_in.load()
            except Exception as error:
                origin = f" of the package {plug_in.dist.name}" if plug_in.dist else ""
                raise UsageError(
                    f"the {self.kind} {plug_in.name!r}{origin} can't be loaded: {error!r}; update or uninstall that package"
                ) from error
            self.member(plug_in.name)(member)


def _home(member: object) -> str:
    """The module that a member, or its class, is defined in."""
    own = member if isinstance(member, type | FunctionType) else type(member)
    return own.__module__


@cache
def _plug_ins() -> Any:  # of another type in Python 3.11 than later, with the same `select`
    """The entry points of all packages; the search takes a while and is done once for all kinds."""
    return entry_points()


def _prefix(form: str) -> str:
    """The common beginning of all names of a form: its letters up to the first choice or capital."""
    match = re.match("[a-z_]*", form)
    return match[0] if match else ""
