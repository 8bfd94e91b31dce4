"""How the example scripts save their .blend: without unused data and local paths, seen through the camera.

Run them in the oldest Blender that LiveHand supports, else that one warns of a file of a newer version.
"""

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import bpy
import livehand
import zstandard

SMALLEST = 19  # zstd's slowest usual level; Blender's own is 3, whose files are a fifth larger


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
            space.region_3d.view_perspective = "CAMERA"
    for browser in _file_browsers():
        browser.params.directory = b"//"
    bpy.context.preferences.filepaths.save_version = 0
    write_small(lambda raw: bpy.ops.wm.save_as_mainfile(filepath=str(raw), compress=False, relative_remap=False), path)


def write_small(write: Callable[[Path], object], path: Path) -> None:
    """Let Blender write a .blend that is not compressed, and compress it to `path` as far as zstd can."""
    with tempfile.TemporaryDirectory() as folder:
        raw = Path(folder) / path.name
        write(raw)
        path.write_bytes(zstandard.ZstdCompressor(SMALLEST).compress(raw.read_bytes()))


def _file_browsers() -> list[bpy.types.SpaceFileBrowser]:
    spaces = (space for screen in bpy.data.screens for area in screen.areas for space in area.spaces)
    return [space for space in spaces if space.type == "FILE_BROWSER" and space.params]
