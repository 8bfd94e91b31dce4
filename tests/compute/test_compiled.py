"""Kernels: their arithmetic is single; where their cache lies and who can write there; that it serves several names."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from livehand.backend.compute.kernels.compiled import compiled, compiled_loosely, writable_cache


def test_single_precision_stays_single():
    """One float64 constant would make a whole kernel double, and slow."""
    third = np.float32(1) / np.float32(3)
    for decorate in (compiled, compiled_loosely):
        double = decorate(_plus_third)
        assert double(np.float32(1)) == np.float32(1) + third
        assert double.signatures[0][0].name == "float32"


def _plus_third(x):
    return x + np.float32(1) / np.float32(3)


UNDER_A_NAME = """
import sys, importlib, importlib.util
name, root = sys.argv[1:]
spec = importlib.util.spec_from_file_location(name, root + "/__init__.py", submodule_search_locations=[root])
sys.modules[name] = package = importlib.util.module_from_spec(spec)
spec.loader.exec_module(package)
import numpy as np
raster = importlib.import_module(name + ".backend.compute.kernels.raster")
corners = np.array([[0, 0], [8, 0], [0, 8]], np.float32)
mesh = raster.ProjectedMesh(corners, np.ones(3, np.float32), np.array([[0, 1, 2]]))
nearest = np.full(64, np.inf, np.float32)
raster.nearest_depth(mesh, 8, 0, 8, True, nearest)
print(int(np.isfinite(nearest).sum()))
"""


@pytest.mark.slow
def test_the_cache_of_one_package_name_does_not_break_another(tmp_path):
    """An extension and a pip package import the same files under two names, and named tuples are cached by name."""
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    root = str(Path(__file__).parents[2])
    for name in ("first_name", "second_name", "first_name"):
        command = [sys.executable, "-c", UNDER_A_NAME, name, root]
        done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=120)
        assert done.stdout.strip() == "36", done.stderr


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
