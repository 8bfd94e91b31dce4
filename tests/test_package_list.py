"""pyproject.toml names its packages one by one, because the repository's root is itself the package `livehand`."""

import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from livehand.backend.runtime.dependencies import REQUIREMENTS
from setuptools import find_packages

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def settings():
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_every_package_is_listed_and_nothing_else(settings):
    listed = settings["tool"]["setuptools"]["packages"]
    found = find_packages(str(ROOT), include=["backend", "backend.*", "livehand_blender", "livehand_blender.*"])
    assert sorted(listed) == sorted(["livehand", *(f"livehand.{name}" for name in found)])


def test_folders_with_modules_are_packages():
    """find_packages does not see a folder without __init__.py."""
    folders = {path.parent for room in ("backend", "livehand_blender") for path in (ROOT / room).rglob("*.py")}
    assert [str(folder) for folder in sorted(folders) if not (folder / "__init__.py").is_file()] == []


def test_the_extension_asks_for_the_packages_that_pip_installs(settings):
    """All but numpy, which Blender brings."""
    of_pip = set(settings["project"]["dependencies"]) - {"numpy>=1.26"}
    assert {requirement.pip for requirement in REQUIREMENTS} == of_pip


def test_the_installed_version_is_that_of_the_manifest():
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert metadata.version("livehand") == manifest["version"]
