"""Whether a process runs, and where its id is valid, on each platform by simulation."""

import os
import subprocess
import sys

import pytest
from livehand.backend.system import processes as process_identity
from livehand.backend.system.processes import is_running, process_space


def test_this_process_runs_and_one_that_ended_does_not():
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    assert is_running(os.getpid())
    assert not is_running(ended.pid)
    assert not is_running(1 << 80)


def test_a_process_of_another_user_runs(monkeypatch):
    def refuse(pid, signal):
        assert signal == 0
        raise PermissionError

    monkeypatch.setattr(os, "kill", refuse)
    assert is_running(1)


def test_windows_is_not_asked_as_the_question_would_end_the_process(monkeypatch):
    monkeypatch.setattr(process_identity.os, "name", "nt")
    monkeypatch.setattr(os, "kill", lambda *_: pytest.fail("os.kill ends processes on Windows"))
    assert is_running(12345)


@pytest.mark.parametrize("platform", ["linux", "darwin", "win32"])
def test_the_space_is_the_same_in_a_child(platform, monkeypatch):
    if platform == "linux" and sys.platform != "linux":
        pytest.skip("reads /proc")
    monkeypatch.setattr(sys, "platform", platform)
    assert process_space() == process_space()
    code = (
        f"import sys; sys.platform = {platform!r}\n"
        "from livehand.backend.system.processes import process_space; print(process_space())"
    )
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert child.stdout.strip() == process_space()
