"""Kernels run where nothing can be written, and are never read from where others can write."""

import os
import subprocess
import sys
import tempfile

import pytest
from livehand.backend.compute.kernels.cache_folder import writable_cache

PROGRAM = """
from pathlib import Path
from livehand.backend.compute.kernels.compiled import compiled

def doubled(value):
    return 2 * value

import livehand.backend.compute.kernels.compiled as module
doubled.__code__ = doubled.__code__.replace(co_filename=module.__file__)
assert compiled(doubled)(21) == 42
"""


@pytest.fixture
def no_home(monkeypatch, tmp_path):
    """A home that nobody can write to, root included, and an empty temporary folder."""
    (tmp_path / "home").write_text("a file")
    (tmp_path / "tmp").mkdir()
    for name in ("XDG_CACHE_HOME", "NUMBA_CACHE_DIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("USERPROFILE", str(tmp_path / "home"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    return tmp_path / "tmp"


def own(tmp):
    return tmp / f"livehand-{os.getuid() if hasattr(os, 'getuid') else 0}"


def test_the_users_cache_comes_first(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert writable_cache("") == tmp_path / "xdg" / "livehand"
    assert writable_cache(str(tmp_path / "numba")) == tmp_path / "numba" / "livehand"


def test_without_a_home_it_is_a_temporary_folder_of_the_users_own(no_home):
    assert writable_cache("") == own(no_home)
    assert os.name == "nt" or own(no_home).stat().st_mode & 0o777 == 0o700
    assert writable_cache("") == own(no_home)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such modes")
def test_a_folder_of_somebody_else_is_not_taken(no_home, monkeypatch):
    own(no_home).mkdir()
    own(no_home).chmod(0o777)
    assert writable_cache("") is None
    own(no_home).rmdir()
    own(no_home).symlink_to(no_home)
    assert writable_cache("") is None
    own(no_home).unlink()
    monkeypatch.setattr(os, "getuid", lambda: 12345)
    own(no_home).mkdir(mode=0o700)
    assert writable_cache("") is None


def test_windows_has_no_user_numbers(no_home, monkeypatch):
    monkeypatch.delattr(os, "getuid", raising=False)
    (no_home / "livehand-0").mkdir()
    (no_home / "livehand-0").chmod(0o777)  # as Windows reports every folder
    assert writable_cache("") == no_home / "livehand-0"


@pytest.mark.slow
@pytest.mark.parametrize("has_temporary", [True, False])
def test_kernels_run_with_a_home_and_an_installation_that_cannot_be_written(no_home, has_temporary):
    if not has_temporary:
        own(no_home).write_text("in the way")
    env = {**os.environ, "TMPDIR": str(no_home), "TEMP": str(no_home), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run([sys.executable, "-c", PROGRAM], env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert own(no_home).is_dir() == has_temporary
    assert [path for path in no_home.parent.rglob("*.nbi") if own(no_home) not in path.parents] == []


FULL = """
import resource
resource.setrlimit(resource.RLIMIT_FSIZE, (2048, 2048))
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="needs limits of files' sizes")
def test_kernels_run_where_the_disk_is_full(tmp_path):
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path), "TMPDIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", FULL + PROGRAM], capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode == 0, done.stderr
