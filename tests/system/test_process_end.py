"""A process ends with its exit code, with all that it printed, after the handlers of `atexit`."""

import subprocess
import sys

import pytest

PROGRAM = """
import atexit, sys
from livehand.backend.system.process_end import run_process

class Hangs:  # as Blender as a module does when the interpreter ends
    def __del__(self):
        while True:
            pass

sys.modules["kept to the end"] = Hangs()
atexit.register(lambda: print("handler"))
def main():
    sys.stdout.write("printed\\n")
    {body}
run_process(main)
"""


@pytest.mark.parametrize(
    ("body", "code", "message"),
    [
        ("return 0", 0, ""),
        ("return 7", 7, ""),
        ("sys.exit(130)", 130, ""),
        ("sys.exit()", 0, ""),
        ("raise ValueError('ours')", 1, "ValueError: ours"),
        ("raise KeyboardInterrupt", 130, ""),
        ("sys.stderr.close(); return 3", 3, ""),
    ],
)
def test_the_process_ends_with_its_code_and_output(body, code, message):
    command = [sys.executable, "-c", PROGRAM.format(body=body)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)
    assert (done.returncode, done.stdout) == (code, "printed\nhandler\n")
    assert done.stderr.strip().splitlines()[-1:] == [message] * bool(message)
