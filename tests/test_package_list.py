"""The pip package: its modules, version and requirements agree with the extension's."""

import re
import tomllib
from importlib import metadata
from pathlib import Path

from livehand.backend.system.packages import GPU, REQUIREMENTS
from packaging.requirements import Requirement

ROOT = Path(__file__).parent.parent


def load_toml(name):
    return tomllib.loads((ROOT / name).read_text(encoding="utf-8"))


def test_folders_with_modules_are_packages():
    """setup.py does not find a folder without __init__.py."""
    folders = {path.parent for room in ("backend", "livehand_blender") for path in (ROOT / room).rglob("*.py")}
    assert [str(folder) for folder in sorted(folders) if not (folder / "__init__.py").is_file()] == []


def test_the_extension_asks_for_the_packages_that_pip_installs():
    """All but numpy, which Blender brings, and scipy, which only training and evaluation use."""
    of_pip = set(load_toml("pyproject.toml")["project"]["dependencies"]) - {"numpy>=1.26", "scipy>=1.11"}
    assert {requirement.pip for requirement in REQUIREMENTS} == of_pip


def test_install_gpu_rendering_brings_what_the_extra_does_by_hashes_of_which_the_lock_file_has_one():
    extra = load_toml("pyproject.toml")["project"]["optional-dependencies"]["gpu"]
    assert [requirement.pip for requirement in GPU] == extra
    (locked,) = re.findall(
        r"^warp-lang==\S+ --hash=sha256:(\w+)$", (ROOT / "requirements.lock").read_text(), re.MULTILINE
    )
    wheels = GPU[0].wheels
    assert locked == next(wheel.sha256 for wheel in wheels if wheel.system == "linux-x86_64")
    assert all(re.fullmatch("[0-9a-f]{64}", wheel.sha256) for wheel in wheels)
    assert len({wheel.sha256 for wheel in wheels}) == len({wheel.system for wheel in wheels}) == 3


def test_the_installed_version_is_that_of_the_manifest():
    assert metadata.version("livehand") == load_toml("blender_manifest.toml")["version"]


def test_the_lock_file_has_a_version_and_a_hash_of_all_that_pip_installs():
    lines = [line for line in (ROOT / "requirements.lock").read_text().splitlines() if not line.startswith("#")]
    locked = dict(re.fullmatch(r"(\S+)==(\S+)(?: --hash=sha256:[0-9a-f]{64})+", line).groups() for line in lines)
    project = load_toml("pyproject.toml")["project"]
    extras = project["optional-dependencies"]
    wanted = map(Requirement, [*project["dependencies"], *(one for name in extras for one in extras[name])])
    ours = [one for one in wanted if one.name != "livehand" and (one.marker is None or one.marker.evaluate())]
    assert len(ours) > 15
    assert [str(one) for one in ours if not one.specifier.contains(locked.get(one.name, "0"))] == []
