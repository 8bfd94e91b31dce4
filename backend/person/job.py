"""A person made in a process of its own, while Blender's window goes on: progress, then an avatar or an error.

The process writes a JSON object a line to its standard output. Its standard input is a pipe that is never written to:
it ends with this process, however that ends, and the work ends with it.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..records.errors import LiveHandError
from ..system.processes import end_by_input
from .command import COMMAND, making
from .kept_steps import remove_work

_START = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from backend.person.job import run; run()"
_END_S = 2.0


@dataclass
class PersonJob:
    """The process, and what it has said so far.

    Attributes:
        output: the avatar that it will write.
    """

    output: Path
    _process: subprocess.Popen[bytes]
    _lines: list[str] = field(default_factory=list)
    _result: Mapping[str, Any] | None = None

    def __post_init__(self):
        self._reader = threading.Thread(target=self._read, name="livehand person", daemon=True)

    @classmethod
    def start(cls, arguments: list[str], output: Path) -> PersonJob:
        """Start `livehand person` with these arguments, which write the output."""
        path = [str(Path(__file__).parents[2]), *filter(None, sys.path)]  # an empty one is the current folder
        command = [sys.executable, "-I", "-c", _START, json.dumps(path), json.dumps(arguments)]
        job = cls(output, subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE))
        job._reader.start()
        return job

    @property
    def last_line(self) -> str:
        """What it does now, for people."""
        return self._lines[-1] if self._lines else "starting"

    @property
    def is_running(self) -> bool:
        """Whether it has neither an avatar nor an error."""
        return self._result is None

    def result(self) -> Mapping[str, Any]:
        """Return what the command reports, after the end.

        Raises:
            LiveHandError: the command's error, or the process has died.
        """
        assert self._result is not None
        if "error" in self._result:
            raise LiveHandError(str(self._result["error"]))
        return self._result

    def wait(self) -> None:
        """Wait for the end."""
        self._reader.join()

    def cancel(self) -> None:
        """End the process; no file is written, and what it kept to go on is removed."""
        end_by_input(self._process, _END_S)
        remove_work(self.output)

    def _read(self) -> None:
        pipe = self._process.stdout
        assert pipe is not None
        result: Mapping[str, Any] | None = None
        with pipe:
            for line in pipe:
                message = _message(line)
                if "progress" in message:
                    self._lines.append(str(message["progress"]))
                elif message:
                    result = message
        code = self._process.wait()
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._result = result or {"error": f"making the avatar ended unexpectedly (code {code}); try again"}


def _message(line: bytes) -> Mapping[str, Any]:
    """Read one line; what is no message is passed over, as other libraries print, too."""
    try:
        message = json.loads(line)
    except ValueError:
        return {}
    return message if isinstance(message, dict) else {}


def run() -> None:
    """Make the person of the arguments in `sys.argv[2]`, and write what happens to the standard output."""
    threading.Thread(target=_end_with_parent, name="livehand parent", daemon=True).start()
    parser = argparse.ArgumentParser(COMMAND.name)
    COMMAND.add_arguments(parser)
    arguments = parser.parse_args(json.loads(sys.argv[2]))
    try:
        _write(dict(making(arguments, lambda line: _write({"progress": line}))))
    except LiveHandError as error:
        _write({"error": str(error)})
    except MemoryError:
        _write({"error": "the avatar needs more memory than is free; close other programs, or give fewer pictures"})


def _write(message: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(message) + "\n")
    sys.stdout.flush()


def _end_with_parent() -> None:
    os.read(sys.stdin.fileno(), 1)
    os._exit(1)
