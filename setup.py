"""Gives setuptools the one thing pyproject.toml cannot: the version, which the extension's manifest holds."""

import tomllib
from pathlib import Path

from setuptools import setup

MANIFEST = Path(__file__).parent / "blender_manifest.toml"

setup(version=tomllib.loads(MANIFEST.read_text(encoding="utf-8"))["version"])
