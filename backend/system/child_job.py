"""A job in a process of its own, while Blender's window goes on: progress, then a result or an error.

The process writes a JSON object a line to its standard output. Its standard input is a pipe that is never written to:
it ends with this process, however that ends, and the work ends with it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, cast

from ..records.errors import LiveHandError
from .processes import end_by_input
from .thread_limits import blas_settings

# The package has the same name there, also as Blender's extension, because compiled kernels are kept by their names.
_START = """
import importlib, json, sys, types
from importlib.util import module_from_spec, spec_from_file_location
sys.path[:], package, root, module = json.loads(sys.argv[1])
above = package.split(".")[:-1]
for number in range(len(above)):
    name = ".".join(above[: number + 1])
    sys.modules[name] = types.ModuleType(name)
    sys.modules[name].__path__ = []
spec = spec_from_file_location(package, root + "/__init__.py", submodule_search_locations=[root])
sys.modules[package] = module_from_spec(spec)
spec.loader.exec_module(sys.modules[package])
importlib.import_module(f"{package}.backend.{module}").run()
"""
_ROOT, _PACKAGE = Path(__file__).parents[2], __name__.removesuffix(".backend.system.child_job")
_END_S = 2.0


class JobProgress(NamedTuple):
    """What a job does now, for people, and which share of it is done; None: not known."""

    text: str
    share: float | None = None


Report = Callable[[JobProgress], None]
"""Tells who waits for a job what it does."""


@dataclass
class ChildJob:
    """The process, and what it has said so far.

    Attributes:
        name: of the job, in messages.
    """

    name: str
    _process: subprocess.Popen[bytes]
    _progress: JobProgress = field(default_factory=lambda: JobProgress("starting"))
    _result: Mapping[str, Any] | None = None

    def __post_init__(self):
        self._reader = threading.Thread(target=self._read, name=f"livehand {self.name}", daemon=True)
        self._reader.start()

    @classmethod
    def start(cls, name: str, module: str, request: Any) -> ChildJob:
        """Start the function `run` of a module of the backend, which is given a request of JSON's types."""
        path = list(filter(None, sys.path))  # an empty one is the current folder
        where = json.dumps([path, _PACKAGE, str(_ROOT), module])
        command = [sys.executable, "-I", "-c", _START, where, json.dumps(request)]
        environment = os.environ | blas_settings()
        return cls(name, subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment))

    @property
    def progress(self) -> JobProgress:
        """What it does now."""
        return self._progress

    @property
    def is_running(self) -> bool:
        """Whether it has neither a result nor an error."""
        return self._result is None

    def result(self) -> Mapping[str, Any]:
        """Return what the job reports, after the end.

        Raises:
            LiveHandError: the job's error, or the process has died.
        """
        assert self._result is not None
        if "error" in self._result:
            raise LiveHandError(str(self._result["error"]))
        return self._result

    def wait(self) -> None:
        """Wait for the end."""
        self._reader.join()

    def cancel(self) -> None:
        """End the process."""
        end_by_input(self._process, _END_S)

    def _read(self) -> None:
        pipe = self._process.stdout
        assert pipe is not None
        result: Mapping[str, Any] | None = None
        with pipe:
            for line in pipe:
                message = _message(line)
                if "progress" in message:
                    self._progress = JobProgress(str(message["progress"]), message.get("share"))
                elif message:
                    result = message
        code = self._process.wait()
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._result = result or {"error": f"{self.name} ended unexpectedly (code {code}); try again"}


def _message(line: bytes) -> Mapping[str, Any]:
    """Read one line; what is no message is passed over, as other libraries print, too."""
    try:
        message = json.loads(line)
    except ValueError:
        return {}
    return cast("Mapping[str, Any]", message) if isinstance(message, dict) else {}


def run_job(work: Callable[[Any, Report], Mapping[str, Any]], too_large: str) -> None:
    """Do the work of a job in its process: give it the request, and write what happens to the standard output.

    Args:
        work: takes the request, and returns a result of JSON's types.
        too_large: the error if memory does not suffice, with what to do.
    """
    threading.Thread(target=_end_with_parent, name="livehand parent", daemon=True).start()
    try:
        _write(dict(work(json.loads(sys.argv[2]), lambda now: _write({"progress": now.text, "share": now.share}))))
    except LiveHandError as error:
        _write({"error": str(error)})
    except MemoryError:
        _write({"error": too_large})


def _write(message: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(message) + "\n")
    sys.stdout.flush()


def _end_with_parent() -> None:
    os.read(sys.stdin.fileno(), 1)
    os._exit(1)
