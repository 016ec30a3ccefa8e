"""Compiled templates, kept on disk: compiling that of a report takes as long as drawing three of its figures."""

from __future__ import annotations

import sys
from contextlib import suppress
from importlib.util import cache_from_source
from os.path import dirname

from jinja2 import FileSystemBytecodeCache
from jinja2.bccache import Bucket


class TemplateCache(FileSystemBytecodeCache):
    """A cache beside the compiled modules of this folder. Where nothing can be kept, templates are compiled each time."""

    def __init__(self) -> None:
        super().__init__(dirname(cache_from_source(__file__)), "%s.jinja")

    def load_bytecode(self, bucket: Bucket) -> None:
        """Take a template from the disk, if it is there and of the same source."""
        try:
            super().load_bytecode(bucket)
        except Exception:  # pickle: what stands in a damaged file may raise anything
            bucket.reset()

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keep a template, if Python may keep modules."""
        if not sys.dont_write_bytecode:
            with suppress(OSError):
                super().dump_bytecode(bucket)
