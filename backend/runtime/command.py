"""The commands of the `livehand` program, and how they run: parse, call, print.

Exit codes: 0 done, 1 a `LiveHandError` (its message on stderr, no traceback), 2 wrong usage, 130 interrupted, by
Ctrl-C, SIGTERM or SIGHUP. With `--json` the last line of stdout is one JSON object: what the function returned.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..records.errors import LiveHandError
from .signals import stopping_as_at_ctrl_c
from .thread_limits import allow_cpu_for_mps, limit_spinning

OK, FAILED, USAGE, INTERRUPTED = 0, 1, 2, 130


class FailedInPart(Exception):
    """A command failed in part and has reported why: its result is printed, and the exit code is 1."""

    def __init__(self, result: Mapping[str, Any]):
        super().__init__()
        self.result = result


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
            result, code = dict(commands[args.command].run(args)), OK
    except FailedInPart as failure:
        result, code = dict(failure.result), FAILED
    except LiveHandError as error:
        sys.stderr.write(f"{program} {args.command}: {error}\n")
        return FAILED
    except KeyboardInterrupt:
        sys.stderr.write(f"{program} {args.command}: interrupted\n")
        return INTERRUPTED
    if result:
        _print_result(result, args.json)
    return code


def parse_size_px(text: str, smallest: int = 4) -> tuple[int, int]:
    """`334x512` -> (width, height), as an argument's type; 4 and 65536 are Blender's own limits of a side."""
    match = re.fullmatch(r"(\d+)[xX](\d+)", text.strip())
    if not match or not all(smallest <= int(side) <= 65536 for side in match.groups()):
        raise argparse.ArgumentTypeError(
            f"must be WIDTHxHEIGHT in px ({smallest} to 65536), such as 334x512, got {text!r}"
        )
    return int(match[1]), int(match[2])


def parse_count(text: str, smallest: int = 1) -> int:
    """A whole number from `smallest`, as an argument's type."""
    if not text.isdecimal() or int(text) < smallest:
        raise argparse.ArgumentTypeError(f"must be a whole number from {smallest}, got {text!r}")
    return int(text)


def say(text: str) -> None:
    """Print a line of a command's output and flush it."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


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
