"""The program that is run: as its own main module, as Python would run it, and without our frames in what it shows."""

from __future__ import annotations

import builtins
import gc
import os
import sys
import traceback
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType, TracebackType

FAILED, INTERRUPTED = 1, 130


class Program:
    """A program at a path, which is `run` as the main module, and goes with all its objects at `drop`."""

    def __init__(self, path: str) -> None:
        self._file = os.path.abspath(path)
        self._before = sys.modules["__main__"]

    def run(self) -> int:
        """Run it and return the exit status; `SystemExit` is left to Python."""
        module = ModuleType("__main__")
        module.__file__, module.__loader__ = self._file, SourceFileLoader("__main__", self._file)
        vars(module)["__builtins__"] = builtins
        sys.modules["__main__"] = module
        try:
            code = compile(Path(self._file).read_bytes(), self._file, "exec", dont_inherit=True)
            exec(code, vars(module))
        except SystemExit:
            raise
        except BaseException as error:
            failure = error
        else:
            return 0
        # Outside of the handler, as where Python calls the hook.
        return self._report(failure)

    def _report(self, error: BaseException) -> int:
        """Show what ended it, by the program's hook if it has one."""
        if isinstance(error, KeyboardInterrupt) and sys.excepthook is sys.__excepthook__:
            sys.stderr.write("servobench: interrupted\n")
            return INTERRUPTED
        shown = error.with_traceback(self._own_frames(error))
        try:
            sys.excepthook(type(shown), shown, shown.__traceback__)
        except SystemExit:
            raise
        except BaseException as wrong:  # as Python does, which shows both
            sys.stderr.write("Error in sys.excepthook:\n")
            traceback.print_exception(wrong.with_traceback(self._own_frames(wrong)), chain=False)
            sys.stderr.write("\nOriginal exception was:\n")
            traceback.print_exception(shown)
        return INTERRUPTED if isinstance(error, KeyboardInterrupt) else FAILED

    def _own_frames(self, error: BaseException) -> TracebackType | None:
        """The part of a traceback that begins in the program; None where it never began to run."""
        trace = error.__traceback__
        while trace and trace.tb_frame.f_code.co_filename != self._file:
            trace = trace.tb_next
        return trace

    def drop(self) -> None:
        """Let its objects go as at the end of Python, so that their finalizers still find the board."""
        module = sys.modules.get("__main__")
        sys.modules["__main__"] = self._before
        if module is None or module is self._before:
            return
        contents = vars(module)
        for name in tuple(contents):
            # What is registered with atexit keeps all globals alive until after this.
            if hasattr(type(contents[name]), "__del__"):
                contents[name] = None
        del module, contents
        gc.collect()
