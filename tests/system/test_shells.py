"""A command as a line for a terminal: what the program gets is what was meant, in each of three languages."""

import re
import shutil
import subprocess
import sys

import pytest
from livehand.backend.system.shells import Shell, command_line, shells_of

ODD = (
    r"C:\Program Files\Blender Foundation\Blender 4.5\4.5\python\bin\python.exe",
    "torch>=2.6,<2.14",
    '/home/Zoë O\'Brien/$HOME `id` "quoted" & co',
    "C:\\Users\\Ann's\\",
    "a^b|c(d)",
    "curly \u2018quotes\u2019",
    "plain",
    "",
)


@pytest.mark.skipif(shutil.which("sh") is None, reason="needs a POSIX shell")
def test_a_posix_shell_passes_on_every_argument():
    show = [sys.executable, "-c", "import sys; print(ascii(sys.argv[1:]))", *ODD]
    said = subprocess.run(["sh", "-c", command_line(show, Shell.SH)], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == ascii(list(ODD))


def test_powershell_calls_the_program_and_replaces_nothing():
    line = command_line(ODD, Shell.POWERSHELL)
    assert line.startswith("& 'C:\\Program Files\\")
    assert powershell_arguments(line.removeprefix("& ")) == list(ODD)


def test_the_command_prompt_passes_on_every_argument():
    paths = [one for one in ODD if '"' not in one]
    line = command_line(paths, Shell.CMD)
    assert line.startswith('"C:\\Program Files\\')
    assert windows_arguments(line) == paths
    assert outside_quotes(line).isdisjoint("<>&|^()")
    assert windows_arguments(command_line(ODD, Shell.CMD)) == list(ODD)


def test_each_system_has_its_terminals():
    assert shells_of("win32") == (Shell.POWERSHELL, Shell.CMD)
    assert shells_of("linux") == shells_of("darwin") == (Shell.SH,)


def powershell_arguments(line):
    """PowerShell's words in single quotes: any of its five quotes ends one, two of them stand for one."""
    words = re.findall(r"'((?:[^'\u2018\u2019\u201a\u201b]|(['\u2018\u2019\u201a\u201b])\2)*)'(?: |$)", line)
    assert sum(len(f"'{word}'") for word, _ in words) + len(words) - 1 == len(line), (
        "something stands outside of quotes"
    )
    return [re.sub("(['\u2018\u2019\u201a\u201b])\\1", r"\1", word) for word, _ in words]


def windows_arguments(line):
    """A program's arguments by the rules of Microsoft's C runtime."""
    arguments, word, in_quotes, begun, position = [], "", False, False, 0
    while position < len(line):
        slashes = len(line) - position - len(line[position:].lstrip("\\"))
        position += slashes
        here = line[position] if position < len(line) else ""
        if here == '"':
            word += "\\" * (slashes // 2)
            if slashes % 2:
                word += '"'
            else:
                in_quotes = not in_quotes
            begun = True
        else:
            word += "\\" * slashes
            if here == " " and not in_quotes:
                if begun or word:
                    arguments.append(word)
                word, begun = "", False
            else:
                word += here
        position += 1
    return [*arguments, word] if begun or word else arguments


def outside_quotes(line):
    """The characters that the Command Prompt itself reads; it knows no escaped quote."""
    return set("".join(line.split('"')[::2]))
