"""The end of the program's process.

Blender as a module frees itself when Python's interpreter ends. That can wait for ever, as after drivers that Python
evaluates, or crash, as after importers beside torch. So the process ends without it, once all is written.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import sys
from collections.abc import Callable
from typing import NoReturn

from .command import FAILED, INTERRUPTED, OK, open_standard_streams


def run_process(main: Callable[[], int]) -> NoReturn:
    """Call `main`, and end the process with the exit code that it returns; an exception is shown as Python shows it."""
    open_standard_streams()
    try:
        code = main()
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else FAILED if stop.code else OK
    except KeyboardInterrupt:
        code = INTERRUPTED
    except BaseException as error:
        sys.excepthook(type(error), error, error.__traceback__)
        code = FAILED
    end_process(code)


def end_process(code: int) -> NoReturn:
    """End the process at once, after the handlers of `atexit`, with all that was printed written."""
    atexit._run_exitfuncs()  # pyright: ignore[reportPrivateUsage]
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):  # closed, or nobody reads it, or there is none
            stream.flush()
    os._exit(code)
