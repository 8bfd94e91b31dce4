"""pyproject.toml names its packages one by one, because the repository's root is itself the package `livehand`."""

import tomllib
from pathlib import Path

from setuptools import find_packages

ROOT = Path(__file__).parent.parent


def test_every_package_is_listed_and_nothing_else():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    listed = settings["tool"]["setuptools"]["packages"]
    found = find_packages(str(ROOT), include=["backend", "backend.*", "livehand_blender", "livehand_blender.*"])
    assert sorted(listed) == sorted(["livehand", *(f"livehand.{name}" for name in found)])


def test_folders_with_modules_are_packages():
    """find_packages does not see a folder without __init__.py."""
    folders = {path.parent for room in ("backend", "livehand_blender") for path in (ROOT / room).rglob("*.py")}
    assert [str(folder) for folder in sorted(folders) if not (folder / "__init__.py").is_file()] == []
