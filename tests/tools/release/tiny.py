"""A tiny extension and a folder of tiny wheels, to make releases of in a second."""

from livehand.backend.system.packages import Requirement
from livehand.tests.fake_wheels import fake_wheel

WANTED = (Requirement("livehand_fake", "livehand-fake>=1"),)
MANIFEST = """schema_version = "1.0.0"

id = "livehand"
version = "0.2.0"
name = "LiveHand"
tagline = "A tiny one"
maintainer = "The tests"
type = "add-on"
blender_version_min = "4.2.0"
license = ["SPDX:GPL-3.0-or-later"]

# Of the table below.
[build]
paths_exclude_pattern = [
  "/tests/",
]

[permissions]
network = "Fetch packages"
"""
SOURCES = {
    "__init__.py": "from . import livehand_blender\n\n\ndef register():\n    pass\n\n\ndef unregister():\n    pass\n",
    "livehand_blender/__init__.py": "",
    "livehand_blender/registration.py": "import bpy\nfrom ..backend.render import session\n",
    "backend/__init__.py": "",
    "backend/render/__init__.py": "",
    "backend/render/session.py": "import numpy\n\n\ndef load():\n    from . import renderer\n",
    "backend/render/renderer.py": "import json\nimport livehand_fake\nfrom .relightable import Relightable\n",
    "backend/render/relightable.py": "class Relightable: ...\n",
    "backend/render/baked.py": "",
}


def write_extension(folder, **more):
    """Write the tiny extension; `more` are sources in place of its own, or beside them, by path."""
    for name, source in (
        SOURCES | more | {"blender_manifest.toml": MANIFEST, "tests/test.py": "import nothing\n"}
    ).items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(source)
    return folder


def write_index(folder):
    """Write wheels: a package for each system and Python that needs one more in Windows, and numpy."""
    needs = ['livehand-for-windows; platform_system == "Windows"', "numpy>=1.22,<2.6"]
    for python in ("cp311", "cp313"):
        for platform in ("win_amd64", "macosx_11_0_arm64", "manylinux_2_17_x86_64"):
            fake_wheel(folder, "livehand-fake", tag=f"{python}-{python}-{platform}", needs=needs)
    fake_wheel(folder, "livehand-fake", "2.0", "cp311-cp311-win_amd64", ["numpy>=1.26"])  # newer than Blender 4.2's
    fake_wheel(folder, "livehand-for-windows")
    for version in ("1.24.3", "1.26.4", "2.2.0"):
        fake_wheel(folder, "numpy", version)
    return folder
