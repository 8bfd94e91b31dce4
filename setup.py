"""Gives setuptools what pyproject.toml cannot: the version, from the extension's manifest, and the list of packages.

The repository's root is itself the package `livehand`, which setuptools cannot find by itself.
"""

import tomllib
from pathlib import Path

from setuptools import find_packages, setup

ROOT = Path(__file__).parent
INSIDE = find_packages(str(ROOT), include=["backend", "backend.*", "livehand_blender", "livehand_blender.*"])

setup(
    script_name="setup.py",  # by this name setuptools knows that this file is no module of the root package
    version=tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))["version"],
    packages=["livehand", *(f"livehand.{name}" for name in INSIDE)],
)
