"""Libraries that read files: those that come with an extra of this package, and how any of them reports damage."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from servobench.core.errors import FormatError, UsageError


def library(module: str, package: str, extra: str, name: str) -> Any:
    """Return an imported module of a package that comes with an extra; `name` is the file that needs it.

    Raises `UsageError`, which says what to install, where the package isn't there.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise UsageError(
            f'{name}: {package}, which this format needs, isn\'t installed: `pip install "servobench[{extra}]"`'
        ) from error


@contextmanager
def format_errors(name: str, kind: str) -> Iterator[None]:
    """Around calls of a library and nothing else, which reports damage by errors of a dozen types: raise `FormatError` instead.

    `name` is the file's, `kind` what it should be. A lack of memory stays one.
    """
    try:
        yield
    except (FormatError, MemoryError):
        raise
    except Exception as error:
        message = " ".join((str(error) or type(error).__name__).split())
        raise FormatError(f"{name} isn't a {kind} file, or is damaged: {message[:200]}") from error
