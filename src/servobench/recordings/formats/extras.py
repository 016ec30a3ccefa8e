"""Libraries that only some formats need and that come with an extra of this package."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from servobench.core.errors import UsageError


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
