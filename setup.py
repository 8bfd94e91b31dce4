"""Gives setuptools the one thing that pyproject.toml cannot: the version, which the extension's manifest holds."""

import tomllib
from pathlib import Path

from setuptools import setup

MANIFEST = Path(__file__).parent / "blender_manifest.toml"

setup(
    script_name="setup.py",  # by this name setuptools knows that this file is no module of the root package
    version=tomllib.loads(MANIFEST.read_text(encoding="utf-8"))["version"],
)
