"""Commands: how each one runs, prints and fails.

Exit codes: 0 done, 1 a `LiveHandError` (its message on stderr, no traceback), 2 wrong usage, 3 with `--strict` what was
there before is of another version, 130 interrupted, by Ctrl-C, SIGTERM or SIGHUP. With `--json` the last line of stdout
is one JSON object: what the function returned.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import json
import os
import re
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..records.errors import LiveHandError
from .memory import memory_message
from .processes import stopping_as_at_ctrl_c
from .thread_limits import allow_cpu_for_mps, limit_spinning

FOV_LIMITS_DEG = 1, 170
"""Of a camera's horizontal angle of view."""


@contextlib.contextmanager
def blender_silenced() -> Generator[None, None, None]:
    """Keep anything from reaching stdout within, such as Blender's `Fra:1 Mem:...`; stderr is not changed.

    C code writes most of that to file descriptor 1; operators report to Python's `sys.stdout`.
    """
    sys.stdout.flush()
    _flush_c()
    terminal = os.dup(1)
    try:
        with open(os.devnull, "w", encoding="utf-8") as nowhere, contextlib.redirect_stdout(nowhere):
            os.dup2(nowhere.fileno(), 1)
            yield
    finally:
        _flush_c()  # else C would print its buffer at exit
        os.dup2(terminal, 1)
        os.close(terminal)


def open_standard_streams() -> None:
    """Open those that the parent closed. Else files that are opened would take their places, and get C's messages."""
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.dup2(os.open(os.devnull, os.O_RDWR), descriptor)
    for descriptor, name in ((1, "stdout"), (2, "stderr")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(descriptor, "w", encoding="utf-8", closefd=False))


def print_nowhere() -> None:
    """Let all that is printed from now on vanish, C's messages too."""
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)


def _flush_c() -> None:
    with contextlib.suppress(OSError, TypeError, AttributeError):  # Windows: no such handle on the C library
        ctypes.CDLL(None).fflush(None)


OK, FAILED, USAGE, OTHER_VERSION, INTERRUPTED = 0, 1, 2, 3, 130


class FailedInPart(Exception):
    """A command failed in part and has reported why: its result is printed, and the exit code is 1, or as given."""

    def __init__(self, result: Mapping[str, Any], code: int = FAILED):
        super().__init__()
        self.result, self.code = result, code


@dataclass(frozen=True)
class Command:
    """One sub-command.

    Attributes:
        name: as typed.
        help: one line.
        add_arguments: declares its arguments.
        run: does the work and returns a result for JSON. Its key `summary` is the text printed without `--json`; an
            empty one prints nothing. Beside its own arguments it gets `json`, and `argv`: the program's arguments.
    """

    name: str
    help: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], Mapping[str, Any]]


def run_commands(program: str, about: str, commands: Mapping[str, Command], argv: Sequence[str] | None = None) -> int:
    """Run the sub-command named by `argv` (None: the process's arguments) and return the exit code."""
    limit_spinning()
    allow_cpu_for_mps()
    try:
        args = _parser(program, about, commands).parse_args(argv)
        args.argv = tuple(sys.argv[1:] if argv is None else argv)
    except SystemExit as stop:  # argparse has printed the usage, or --help
        return OK if not stop.code else USAGE
    try:
        with stopping_as_at_ctrl_c():
            result, code = _result_and_code(commands[args.command], args)
        if result:
            _print_result(result, args.json)
        return code
    except LiveHandError as error:
        warn(f"{program} {args.command}: {error}")
        return FAILED
    except KeyboardInterrupt:
        warn(f"{program} {args.command}: interrupted")
        return INTERRUPTED
    except (MemoryError, RuntimeError) as error:
        message = memory_message(error)
        if message is None:
            raise
        warn(f"{program} {args.command}: {message}")
        return FAILED


MOST_PIXELS = 1 << 27
"""Of an image, about 16k x 8k: its passes take 3 GB."""


def parse_size_px(text: str, smallest: int = 4) -> tuple[int, int]:
    """Parse (width, height), as `334x512`, as an argument's type; 4 and 65536 are Blender's own limits of a side."""
    match = re.fullmatch(r"(\d+)[xX](\d+)", text.strip())
    if not match or not all(smallest <= int(side) <= 65536 for side in match.groups()):
        raise argparse.ArgumentTypeError(
            f"must be WIDTHxHEIGHT in px ({smallest} to 65536), such as 334x512, got {text!r}"
        )
    width, height = int(match[1]), int(match[2])
    if width * height > MOST_PIXELS:
        raise argparse.ArgumentTypeError(f"must have at most {MOST_PIXELS} pixels, got {text!r} ({width * height})")
    return width, height


def parse_count(text: str, smallest: int = 1) -> int:
    """Parse a whole number from `smallest`, as an argument's type."""
    if not text.isdecimal() or int(text) < smallest:
        raise argparse.ArgumentTypeError(f"must be a whole number from {smallest}, got {text!r}")
    return int(text)


def parse_fov(text: str) -> float:
    """Parse a camera's horizontal angle of view, degrees, as an argument's type."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    least, most = FOV_LIMITS_DEG
    if not least <= value <= most:
        raise argparse.ArgumentTypeError(f"must be an angle of {least} to {most} degrees, got {text!r}")
    return value


def say(text: str) -> None:
    """Print a line of a command's output and flush it. Once nobody reads it any more, as after `| head -1`, nothing is.

    Raises:
        LiveHandError: it cannot be written, as when the disk is full.
    """
    try:
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()
    except BrokenPipeError:
        print_nowhere()
    except OSError as error:
        raise LiveHandError(f"the output cannot be printed ({error.strerror}); print it elsewhere") from error


def warn(text: str) -> None:
    """Print a line on stderr, if anybody reads it."""
    with contextlib.suppress(OSError):
        sys.stderr.write(f"{text}\n")
        sys.stderr.flush()


def _result_and_code(command: Command, args: argparse.Namespace) -> tuple[dict[str, Any], int]:
    try:
        return dict(command.run(args)), OK
    except FailedInPart as failure:
        return dict(failure.result), failure.code


def _parser(program: str, about: str, commands: Mapping[str, Command]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(program, description=about)
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, command in commands.items():
        subparser = subparsers.add_parser(name, help=command.help, description=command.help)
        command.add_arguments(subparser)
        subparser.add_argument("--json", action="store_true", help="print the result as JSON on the last line")
    return parser


def _print_result(result: dict[str, Any], as_json: bool) -> None:
    summary = result.pop("summary", None)
    if as_json:
        say(json.dumps(result))
    elif summary:
        say(summary)
    elif summary is None:
        for key, value in result.items():
            say(f"{key}: {value}")
