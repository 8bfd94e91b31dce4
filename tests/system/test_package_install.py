"""Packages that pip installs into a folder of LiveHand's own: all of them or none, and numpy stays Blender's."""

import hashlib
import os
import shutil
import subprocess
import sys
import sysconfig
import time
from pathlib import PureWindowsPath
from types import SimpleNamespace

import numpy as np
import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.system import package_install
from livehand.backend.system.package_install import (
    PackageInstall,
    PipJob,
    download_mb,
    install_command,
    pip_program,
)
from livehand.backend.system.packages import GPU, REQUIREMENTS, PinnedWheel, Requirement, pip_requirements, wheel_here
from livehand.tests.fake_wheels import fake_wheel

pytestmark = pytest.mark.slow

WANTED = (Requirement("livehand_fake", "livehand-fake>=1"),)


@pytest.fixture
def index(tmp_path, monkeypatch):
    """A folder of wheels that pip takes for the only index: a package, what it needs, and numpy."""
    folder = tmp_path / "index"
    fake_wheel(folder, "livehand-fake", needs=["livehand-inner", "numpy"])
    fake_wheel(folder, "livehand-inner")
    fake_wheel(folder, "numpy", np.__version__, files={"numpy.libs/lib.so": ""})
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(folder))
    monkeypatch.delenv("PIP_EXTRA_INDEX_URL", raising=False)
    return folder


@pytest.fixture
def folder(tmp_path):
    """As a user's may be called."""
    return tmp_path / "Zoë's files" / "py311"


def installed(folder):
    return sorted(path.name for path in folder.iterdir())


def test_packages_and_what_they_need_come_into_the_folder_without_numpy(index, folder, monkeypatch):
    install = PackageInstall.start(WANTED, folder)
    install.job.wait()
    install.finish()
    assert [name for name in installed(folder) if "dist-info" not in name] == ["livehand_fake", "livehand_inner"]
    assert [path.name for path in folder.parent.iterdir()] == ["py311"]
    monkeypatch.syspath_prepend(str(folder))
    import livehand_fake

    assert livehand_fake.version == "1.0"


@pytest.mark.parametrize("settings", [{"PIP_USER": "1"}, {"PIP_REQUIRE_VIRTUALENV": "1"}])
def test_a_users_own_settings_of_pip_do_not_stop_it(index, folder, monkeypatch, settings):
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    python = sys._base_executable  # outside of a virtual environment, as Blender's
    monkeypatch.setattr(package_install, "pip_program", lambda: [python, "-P", "-m", "pip"])
    install = PackageInstall.start(WANTED, folder)
    install.job.wait()
    install.finish()
    assert "livehand_fake" in installed(folder)


def test_what_is_there_keeps_its_version(index, folder):
    first = PackageInstall.start((Requirement("livehand_inner", "livehand-inner"),), folder)
    first.job.wait()
    first.finish()
    fake_wheel(index, "livehand-inner", "2.0")
    second = PackageInstall.start(WANTED, folder)
    second.job.wait()
    second.finish()
    assert [name for name in installed(folder) if "inner" in name] == ["livehand_inner", "livehand_inner-1.0.dist-info"]
    assert (folder / "livehand_inner" / "__init__.py").read_text() == "version = '1.0'\n"


def test_a_package_that_is_not_there_is_an_error_and_changes_nothing(index, folder):
    install = PackageInstall.start((*WANTED, Requirement("none", "livehand-none")), folder)
    install.job.wait()
    with pytest.raises(LiveHandError, match=r"pip must install the packages, got: .*livehand-none.*; check"):
        install.finish()
    assert installed(folder) == []
    assert installed(folder.parent) == ["py311"]


def pinned(path, sha256=None):
    """What asks for the wheel at a path by its hash, or by another one, beside another system's."""
    ours = PinnedWheel(sysconfig.get_platform(), sha256 or hashlib.sha256(path.read_bytes()).hexdigest(), 3)
    name = path.name.split("-")[0]
    return (Requirement(name, f"{name.replace('_', '-')}==1.0", wheels=(PinnedWheel("elsewhere", "0" * 64, 9), ours)),)


def test_a_pinned_package_comes_by_its_hash_beside_others_and_without_what_it_needs(index, folder):
    inner = PackageInstall.start((Requirement("livehand_inner", "livehand-inner"),), folder)
    inner.job.wait()
    inner.finish()
    wheel = fake_wheel(index, "livehand-kernels", needs=["livehand-fake", "numpy"])
    install = PackageInstall.start(pinned(wheel), folder)
    install.job.wait()
    install.finish()
    names = [name for name in installed(folder) if "dist-info" not in name]
    assert names == ["livehand_inner", "livehand_kernels"]
    assert installed(folder.parent) == ["py311"]


def test_a_pinned_package_of_another_hash_is_refused_and_nothing_is_kept(index, folder):
    wheel = fake_wheel(index, "livehand-kernels")
    install = PackageInstall.start(pinned(wheel, "1" * 64), folder)
    install.job.wait()
    with pytest.raises(LiveHandError, match="pip must install the packages, got: THESE PACKAGES DO NOT MATCH THE HASH"):
        install.finish()
    assert installed(folder) == []
    assert installed(folder.parent) == ["py311"]


def test_a_pinned_package_that_no_index_has_is_an_error(index, folder):
    wheel = fake_wheel(index, "livehand-kernels")
    wanted = pinned(wheel)
    wheel.unlink()
    install = PackageInstall.start(wanted, folder)
    install.job.wait()
    with pytest.raises(LiveHandError, match=r"pip must install the packages, got: .*livehand-kernels==1\.0.*; check"):
        install.finish()
    assert installed(folder) == []


@pytest.mark.parametrize(
    ("system", "megabytes"),
    [("linux-x86_64", 149), ("linux-aarch64", 148), ("win-amd64", 135), ("macosx-11.0-arm64", 0)],
)
def test_a_pinned_package_has_the_size_of_its_own_file_for_a_system(monkeypatch, folder, system, megabytes):
    monkeypatch.setattr(sysconfig, "get_platform", lambda: system)
    assert download_mb(GPU, "") == download_mb(GPU, "somewhere") == megabytes
    assert (wheel_here(GPU[0]) is None) == (megabytes == 0)
    assert download_mb((*GPU, Requirement("a", "a", 100)), "") - megabytes == download_mb(
        (Requirement("a", "a", 100),), ""
    )
    assert wheel_here(REQUIREMENTS[0]) is None
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=5 * megabytes * (1 << 20) - 1))
    with pytest.raises(LiveHandError, match=f"must have {5 * megabytes} MB of free space"):
        PackageInstall.start(GPU, folder)


def test_a_canceled_install_ends_its_process_and_leaves_nothing(folder, monkeypatch):
    slow = "import sys, time; print('Collecting torch'); open(sys.argv[-1] + '.part', 'w').close(); time.sleep(600)"
    monkeypatch.setattr(package_install, "pip_program", lambda: [sys.executable, "-c", slow])
    install = PackageInstall.start(WANTED, folder)
    while install.job.last_line == "Starting pip":
        time.sleep(0.01)
    assert install.job.last_line == "Collecting torch"
    assert install.job.is_running
    install.cancel()
    assert install.job._process.poll() is not None
    assert not install.job.is_running
    assert installed(folder) == []
    assert installed(folder.parent) == ["py311"]


def test_the_progress_follows_what_lies_on_the_disk_and_never_goes_back(folder, monkeypatch):
    monkeypatch.setattr(package_install, "pip_program", lambda: [sys.executable, "-c", "import time; time.sleep(600)"])
    install = PackageInstall.start((Requirement("a", "a", 2),), folder)
    try:
        assert install.progress() < 0.01
        part = install.job.temporary / "a.whl"
        part.write_bytes(bytes(1 << 20))
        halfway = install.progress()
        assert 0.3 < halfway < 0.5 if sys.platform == "linux" else halfway > 0.3
        part.unlink()
        assert install.progress() == halfway
        install.job._lines.append("Installing collected packages: a")
        assert install.progress() == 0.8
    finally:
        install.cancel()


def test_a_disk_without_room_is_an_error_before_anything_is_downloaded(folder, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=1 << 20))
    with pytest.raises(LiveHandError, match=r"must have [\d,]+ MB of free space, got 1; make room"):
        PackageInstall.start(REQUIREMENTS, folder)
    assert installed(folder.parent) == ["py311"]


def test_a_folder_that_cannot_be_made_is_an_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(LiveHandError, match="must be writable"):
        PackageInstall.start(WANTED, tmp_path / "file" / "py311")


def test_what_a_killed_process_left_is_removed_and_what_a_living_one_has_is_not(index, folder):
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        pass
    own = f"py313~{os.getpid()}"
    for name in (f"py311~{ended.pid}", f"livehand~{ended.pid}-abc", own):
        (folder.parent / name).mkdir(parents=True)
    install = PackageInstall.start(WANTED, folder)
    install.job.wait()
    install.finish()
    assert installed(folder.parent) == ["py311", own]


def test_pip_writes_what_it_says_in_utf8_whatever_the_console_takes(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    text = "import sys; print('Übung', sys.stdout.encoding)"
    monkeypatch.setattr(package_install, "pip_program", lambda: [sys.executable, "-c", text])
    job = PipJob.start([], tmp_path / "t")
    job.wait()
    assert job.last_line == "Übung utf-8"


def test_without_pip_the_one_of_python_itself_runs(monkeypatch):
    find = package_install.importlib.util.find_spec
    monkeypatch.setattr(package_install.importlib.util, "find_spec", lambda name: None if name == "pip" else find(name))
    said = subprocess.run([*pip_program(), "--version"], capture_output=True, text=True, check=True).stdout
    assert said.startswith("pip ")
    assert "_bundled" in said
    monkeypatch.setattr(package_install.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(LiveHandError, match="must have pip, got none"):
        pip_program()


def test_torch_is_the_one_for_cpus_where_the_usual_one_brings_cuda_and_one_whose_paths_windows_takes():
    torch = REQUIREMENTS[:1]
    assert torch[0].module == "torch"
    assert pip_requirements(torch, "linux") == ["torch==2.13.0+cpu"]
    assert pip_requirements(torch, "linux", has_cpu_index=False) == [torch[0].pip]
    assert pip_requirements(torch, "win32") == ["torch>=2.6,<2.13"]
    assert pip_requirements(torch, "darwin") == [torch[0].pip]


def test_the_size_tells_of_cuda(monkeypatch):
    monkeypatch.setattr(package_install.sys, "platform", "linux")
    assert download_mb(REQUIREMENTS, "somewhere") == sum(one.megabytes for one in REQUIREMENTS)
    assert download_mb(REQUIREMENTS, "") > 2500
    assert download_mb(REQUIREMENTS[1:], "") == download_mb(REQUIREMENTS[1:], "somewhere")
    monkeypatch.setattr(package_install.sys, "platform", "win32")
    assert 170 < download_mb(REQUIREMENTS, "") < 210


def test_the_command_names_python_folder_index_and_packages(tmp_path):
    command = install_command(WANTED, tmp_path, "https://example.org/cpu")
    assert command[:4] == [sys.executable, "-P", "-m", "pip"]
    place = ["--target", str(tmp_path), "--extra-index-url", "https://example.org/cpu"]
    assert command[4:] == ["install", *place, "livehand-fake>=1", f"numpy=={np.__version__}"]
    assert install_command(WANTED)[4:] == ["install", "livehand-fake>=1", f"numpy=={np.__version__}"]


def test_the_longest_file_of_torch_fits_into_a_windows_path(monkeypatch):
    """The longest one of torch 2.12.1 for Windows, for a user's name of 20 letters, while it is installed, too."""
    inside = (
        "torch/include/ATen/native/transformers/cuda/mem_eff_attention/iterators/"
        "predicated_tile_access_iterator_residual_last.h"
    )
    user = PureWindowsPath("C:/Users") / ("u" * 20) / "AppData"
    home = user / "Roaming/Blender Foundation/Blender/4.2/extensions/.user/user_default/livehand/packages"
    monkeypatch.setattr(os, "getpid", lambda: 99999)
    unfinished = package_install._unfinished(home / "py311")
    pips_own = user / "Local/Temp" / f"livehand~{99999}-abcdefgh" / "pip-target-abcdefgh" / "lib" / "python"
    assert len(inside) == 119
    assert max(len(str(folder / inside)) for folder in (home / "py311", unfinished, pips_own)) <= 259
