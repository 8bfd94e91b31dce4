"""Install a zip of this system and render a frame: `python -m livehand.tools.release.try_zip ZIP [--image PNG]`.

Blender as a module, in a process of its own whose Python sees nothing but itself, Blender and Blender's numpy, with an
empty user folder: what is missing in the zip is missing there.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...backend.records.errors import LiveHandError
from .check import OPTIONAL, target_of
from .imports import imports_of, sources_of_zip

OF_BLENDER = ("bpy", "numpy", "numpy.libs")
_SECONDS = 1800  # kernels are compiled, on a machine that may be busy
_TRY = """
import importlib, json, sys, time
blender, zip_path, image_path, *modules = sys.argv[1:]
sys.path.append(blender)
import bpy, addon_utils

def report(**facts):
    print("TRIED " + json.dumps(facts), flush=True)

begun = time.monotonic()
bpy.ops.extensions.package_install_files(filepath=zip_path, repo="user_default", enable_on_install=True)
report(install_s=round(time.monotonic() - begun, 1))
try:
    begun = time.monotonic()
    missing = {}
    for name in modules:
        try:
            importlib.import_module(name)
        except ImportError as error:
            missing[name] = error.name or str(error)
    report(import_s=round(time.monotonic() - begun, 1), modules=len(modules), missing=missing)
    found = {name: getattr(sys.modules.get(name), "__file__", None) for name in ("torch", "numba", "numpy")}
    report(found=found)
    if image_path:
        bpy.ops.wm.read_homefile(use_empty=True)
        bpy.ops.livehand.add_hand(studio=True)
        scene = bpy.context.scene
        scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
        scene.camera.location, scene.camera.rotation_euler = (0, -0.6, 0.08), (1.5708, 0, 0)
        scene.collection.objects.link(scene.camera)
        bpy.ops.livehand.set_engine()
        scene.render.resolution_x, scene.render.resolution_y = 167, 256
        scene.render.filepath = image_path
        begun = time.monotonic()
        bpy.ops.render.render(write_still=True)
        report(render_s=round(time.monotonic() - begun, 1))
finally:
    addon_utils.disable("bl_ext.user_default.livehand")
"""


def try_zip(path: Path, image: Path | None = None) -> dict[str, Any]:
    """Install a zip, import all that Blender and the renderer reach, and render into `image`; returns what was found.

    Raises:
        LiveHandError: the installed extension does not import or render, or uses packages that are not its own.
    """
    modules = [_dotted(module.parts) for module in sorted(imports_of(sources_of_zip(path)).modules)]
    with tempfile.TemporaryDirectory() as temporary:
        blender, user = Path(temporary) / "blender", Path(temporary) / "user"
        blender.mkdir()
        for name in OF_BLENDER:
            if (found := _site_of(name)).exists():
                (blender / name).symlink_to(found)
        arguments = [str(blender), str(path.resolve()), str(image.resolve()) if image else "", *modules]
        try:
            done = subprocess.run(
                [sys.executable, "-I", "-S", "-c", _TRY, *arguments],
                env=os.environ | {"BLENDER_USER_RESOURCES": str(user)},
                cwd=temporary,
                capture_output=True,
                text=True,
                timeout=_SECONDS,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            so_far = (error.stdout or b"").decode(errors="replace")[-500:]
            raise LiveHandError(f"{path.name} must render within {_SECONDS} s, got only: {so_far}") from None
        facts: dict[str, Any] = {}
        for line in done.stdout.splitlines():
            if line.startswith("TRIED "):
                facts |= json.loads(line.removeprefix("TRIED "))
        if done.returncode or (image is not None and "render_s" not in facts):
            raise LiveHandError(f"{path.name} must install and render, got: {(done.stdout + done.stderr)[-1500:]}")
        missing = {module: name for module, name in facts.pop("missing").items() if name not in OPTIONAL}
        strangers = [file for name, file in facts["found"].items() if file and not _is_own(file, name, blender, user)]
        if missing or strangers:
            raise LiveHandError(f"{path.name} must bring all that it imports, got {missing or strangers}")
    return facts


def _is_own(file: str, name: str, blender: Path, user: Path) -> bool:
    """Return whether a module is the zip's, or numpy Blender's."""
    return Path(file).is_relative_to(blender if name == "numpy" else user)


def _dotted(parts: Sequence[str]) -> str:
    names = [*parts[:-1], *([] if parts[-1] == "__init__.py" else [parts[-1].removesuffix(".py")])]
    return ".".join(["bl_ext.user_default.livehand", *names])


def _site_of(name: str) -> Path:
    """Return where a package of Blender lies; it is not imported."""
    found = importlib.util.find_spec(name.partition(".")[0])
    folder = next(iter(found.submodule_search_locations or ()), None) if found else None
    if folder is None:
        raise LiveHandError(f"{name} must be there to try a zip, got none; pip install bpy")
    return Path(folder).with_name(name)


def main(arguments: Sequence[str] | None = None) -> int:
    """Try a zip; return the exit code."""
    parser = argparse.ArgumentParser(description="install a zip of this system and render a frame")
    parser.add_argument("zip", type=Path)
    parser.add_argument("--image", type=Path, help="the frame that is rendered; without it nothing is")
    args = parser.parse_args(arguments)
    target = target_of(args.zip)
    if target is None or target.python != f"{sys.version_info.major}.{sys.version_info.minor}":
        sys.stderr.write(f"{args.zip.name} is not for this Python\n")
        return 1
    try:
        facts = try_zip(args.zip, args.image)
    except LiveHandError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    sys.stdout.write(f"{args.zip.name}: {json.dumps(facts)}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
