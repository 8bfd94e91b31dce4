"""How the example scripts save their .blend: without unused data and local paths, rendered through the camera."""

import sys
from collections.abc import Callable
from pathlib import Path

import bpy
import livehand


def write_example(build: Callable[[], object], default: Path) -> None:
    """Build a scene in an empty file and save it to the path on the command line, or to `default`."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else default
    livehand.register()
    try:
        bpy.ops.wm.read_homefile(use_empty=True)
        build()
        _save(path)
    finally:
        livehand.unregister()
    print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")


def _save(path: Path) -> None:
    bpy.data.orphans_purge(do_recursive=True)
    for space in (space for screen in bpy.data.screens for area in screen.areas for space in area.spaces):
        if space.type == "VIEW_3D":  # a finished shot, not a hand somewhere in an empty view
            space.region_3d.view_perspective, space.shading.type = "CAMERA", "RENDERED"
    for browser in _file_browsers():
        browser.params.directory = b"//"
    bpy.context.preferences.filepaths.save_version = 0
    bpy.ops.wm.save_as_mainfile(filepath=str(path.resolve()), compress=True, relative_remap=False)


def _file_browsers() -> list[bpy.types.SpaceFileBrowser]:
    spaces = (space for screen in bpy.data.screens for area in screen.areas for space in area.spaces)
    return [space for space in spaces if space.type == "FILE_BROWSER" and space.params]
