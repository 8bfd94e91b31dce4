"""A command as one line for a terminal: POSIX shells, PowerShell, and Windows' Command Prompt."""

from __future__ import annotations

import enum
import re
import shlex
import sys
from collections.abc import Sequence

_PLAIN = re.compile(r"[\w./:\\=+,-]+", re.ASCII)
_POWERSHELL_QUOTES = re.compile("['\u2018\u2019\u201a\u201b]")


class Shell(enum.Enum):
    """A terminal's language, by the name that its users know."""

    SH = "Terminal"
    POWERSHELL = "PowerShell"
    CMD = "Command Prompt"


def shells_of(system: str = sys.platform) -> tuple[Shell, ...]:
    """List those of a system (`sys.platform`), the usual one first."""
    return (Shell.POWERSHELL, Shell.CMD) if system == "win32" else (Shell.SH,)


def command_line(command: Sequence[str], shell: Shell) -> str:
    """Return a program and its arguments as a line that this shell runs.

    PowerShell takes a line that begins with a quote for a text, so there it begins with `&`; within its single quotes
    nothing is replaced, and it takes curly ones for them. In the Command Prompt, double quotes hold `<`, `>`, `&` and
    `^`; backslashes before a closing quote are doubled for the program.
    """
    if shell is Shell.SH:
        return shlex.join(command)
    if shell is Shell.POWERSHELL:
        return " ".join(["&", *(f"'{_POWERSHELL_QUOTES.sub(_doubled, part)}'" for part in command)])
    return " ".join(map(_for_command_prompt, command))


def _doubled(match: re.Match[str]) -> str:
    return 2 * match[0]


def _for_command_prompt(part: str) -> str:
    if _PLAIN.fullmatch(part):
        return part
    with_quotes = re.sub(r'(\\*)"', r'\1\1\\"', part)
    before_the_end = re.sub(r"(\\+)$", r"\1\1", with_quotes)
    return f'"{before_the_end}"'
