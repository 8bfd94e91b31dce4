"""Kernels: their arithmetic is single; where their cache lies and who can write there; that it serves several names."""

import importlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from livehand.backend.compute.kernels import compiled as compiled_module
from livehand.backend.compute.kernels.cache_folder import (
    has_kernels,
    is_prepared,
    kernel_folder_name,
    mark_prepared,
    writable_cache,
)
from livehand.backend.compute.kernels.compiled import (
    _cache_folder,
    compiled,
    compiled_loosely,
    compiled_part,
    kernel_counts,
)


def test_single_precision_stays_single():
    """One float64 constant would make a whole kernel double, and slow."""
    third = np.float32(1) / np.float32(3)
    for decorate in (compiled, compiled_loosely):
        double = decorate(_plus_third)
        assert double(np.float32(1)) == np.float32(1) + third
        assert double.signatures[0][0].name == "float32"


def _plus_third(x):
    return x + np.float32(1) / np.float32(3)


def test_whether_all_kernels_are_compiled_is_known_without_numba(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert not is_prepared()
    folder = tmp_path / "livehand" / kernel_folder_name()
    (folder / "kernels_1").mkdir(parents=True)
    assert not has_kernels()
    (folder / "kernels_1" / "rays.march-1.py311.1.nbc").touch()
    assert has_kernels()
    assert not is_prepared()
    mark_prepared(folder)
    assert is_prepared()
    assert _cache_folder(str(tmp_path)) == folder


def test_a_part_of_a_kernel_called_by_python_is_an_error_before_and_after_it_is_compiled():
    """It has no entry for Python, where numba would jump to nowhere."""
    part = compiled_part(_plus_third)
    kernel = compiled(lambda x: part(x) + x)
    message = "'_plus_third' is a part of kernels, which they alone call; decorate it as a kernel"
    with pytest.raises(TypeError, match=message):
        part(np.float32(1))
    assert kernel(np.float32(1)) == part.py_func(np.float32(1)) + np.float32(1)
    assert part.signatures
    with pytest.raises(TypeError, match=message):
        part(np.float32(1))


def test_python_calls_no_part_of_a_kernel():
    """Which would be an error, also where no test runs it."""
    from livehand.backend.compute.cpu import backend

    folder = Path(backend.__file__).parent
    for source in folder.glob("*.py"):
        module = importlib.import_module(f"{backend.__package__}.{source.stem}")
        named = vars(module) | {
            f"{alias}.{name}": value
            for alias, kernels in vars(module).items()
            if getattr(kernels, "__package__", "") == compiled_module.__package__
            for name, value in vars(kernels).items()
            if f"{alias}.{name}(" in source.read_text()
        }
        assert [name for name, value in named.items() if isinstance(value, compiled_module.KernelPart)] == [], source


@pytest.mark.slow
def test_kernels_with_machine_code_are_counted():
    from livehand.backend.compute.kernels import raster

    compiled_before, every = kernel_counts()
    assert 0 <= compiled_before <= every
    assert every >= 8
    mesh = raster.ProjectedMesh(np.zeros((3, 2), np.float32), np.ones(3, np.float32), np.array([[0, 1, 2]], np.int16))
    raster.nearest_depth(mesh, 2, 0, 2, True, np.full(4, np.inf, np.float32))
    assert kernel_counts()[0] >= max(compiled_before, 1)


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


@pytest.fixture
def caches(no_home, monkeypatch):
    """A shared folder in which the user's cache is configured to lie."""
    (no_home.parent / "shared").mkdir(mode=0o700)
    monkeypatch.setenv("XDG_CACHE_HOME", str(no_home.parent / "shared" / "cache"))
    return no_home.parent / "shared"


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such modes")
def test_a_configured_cache_is_made_for_the_user_alone(caches, monkeypatch):
    before = os.umask(0)
    try:
        assert writable_cache("") == caches / "cache" / "livehand"
    finally:
        os.umask(before)
    assert {(caches / name).stat().st_mode & 0o777 for name in ("cache", "cache/livehand")} == {0o700}


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such modes")
@pytest.mark.parametrize("above", ["shared", "cache"])
def test_a_cache_that_others_could_replace_is_not_taken(caches, no_home, above):
    """As with HOME=/tmp, where /tmp/.cache belongs to whoever was first."""
    assert writable_cache("") == caches / "cache" / "livehand"
    folder = caches if above == "shared" else caches / "cache"
    folder.chmod(0o777)
    assert writable_cache("") == own(no_home)
    folder.chmod(0o1777)  # as temporary folders are: what lies there stays its owner's
    assert writable_cache("") == caches / "cache" / "livehand"


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such modes")
def test_a_cache_that_others_can_write_to_is_left_for_another(caches, no_home):
    cache = caches / "cache"
    assert writable_cache("") == cache / "livehand"
    (cache / "livehand").chmod(0o777)
    assert writable_cache("") == cache / "livehand-kernels"
    (cache / "livehand-kernels").rmdir()
    (cache / "livehand-kernels").symlink_to(no_home)
    assert writable_cache("") == own(no_home)


@pytest.mark.skipif(not hasattr(os, "chown") or os.getuid() != 0, reason="needs root, who may give files away")
@pytest.mark.parametrize("given", ["cache", "cache/livehand"])
def test_a_cache_of_somebody_else_is_not_taken(caches, no_home, given):
    assert writable_cache("") == caches / "cache" / "livehand"
    os.chown(caches / given, 12345, 12345)
    assert writable_cache("") == (own(no_home) if given == "cache" else caches / "cache" / "livehand-kernels")


@pytest.mark.skipif(os.name == "nt", reason="Windows has no groups")
@pytest.mark.parametrize(
    ("name", "members", "is_private"), [("me", [], True), ("me", ["you"], False), ("staff", [], False)]
)
def test_a_group_of_the_users_own_is_nobody_else(caches, no_home, monkeypatch, name, members, is_private):
    import grp
    import pwd

    assert writable_cache("") == caches / "cache" / "livehand"
    (caches / "cache").chmod(0o770)
    monkeypatch.setattr(pwd, "getpwuid", lambda user: SimpleNamespace(pw_name="me"))
    monkeypatch.setattr(grp, "getgrgid", lambda group: SimpleNamespace(gr_name=name, gr_mem=members))
    assert writable_cache("") == (caches / "cache" / "livehand" if is_private else own(no_home))


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
