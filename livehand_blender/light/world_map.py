"""The map of a world with any node tree: saved in the main thread, rendered once by a Blender of its own, and kept.

A render within the running one would corrupt it, and in Blender's window renders do not run in the main thread; a
process of its own works in every case, beside a render or a 3D view.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
import threading
import weakref
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import bpy
import numpy as np

from ...backend.records.errors import LiveHandError
from ...backend.records.light import Lamp
from ..scene.main_thread import call_in_main_thread
from ..scene.node_values import images_of, objects_of, tree_values
from .sky_suns import CloseUp, extract_suns

_TIMEOUT_S = 600.0
_TIMED_IMAGES = {"SEQUENCE", "MOVIE"}


class WorldMap(NamedTuple):
    """The light that a world emits.

    Attributes:
        radiance: [H, W, 3] as in `Sky`, linear Rec.709, without the suns.
        suns: small bright spots.
    """

    radiance: np.ndarray
    suns: tuple[Lamp, ...]


class RenderedWorld:
    """A world of certain content; the same object for the same content, as long as it is kept."""

    def __init__(self, name: str):
        self._name = name
        self._folder: Path | None = None
        self._map: WorldMap | None = None
        self._lock = threading.Lock()

    @property
    def is_rendered(self) -> bool:
        """Whether `map` returns at once."""
        return self._map is not None

    def save(self, world: bpy.types.World, scene: bpy.types.Scene) -> None:
        """Save what the render needs, if it has not been rendered yet; in any thread that may read the scene."""
        if self._map is None and self._folder is None:
            folder = Path(tempfile.mkdtemp(prefix="livehand_world_"))
            weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
            request = _request(world, scene)
            call_in_main_thread(lambda: _save(world.original, request, folder))
            self._folder = folder

    def map(self) -> WorldMap:
        """Return the map, rendered at the first call, in any thread.

        Raises:
            LiveHandError: the world cannot be rendered.
        """
        with self._lock:
            if self._map is None:
                assert self._folder is not None, "the world must be saved first"
                self._map = _render(self._name, self._folder)
                shutil.rmtree(self._folder, ignore_errors=True)
        return self._map


def rendered_world(world: bpy.types.World, scene: bpy.types.Scene) -> RenderedWorld:
    """Return the map of an evaluated world, saved for its render unless it is known.

    Raises:
        LiveHandError: the world cannot be saved.
    """
    content = [bpy.data.filepath, tree_values(world.node_tree)]
    if any(image.source in _TIMED_IMAGES for image in images_of(world.node_tree)):
        content.append(scene.frame_current_final)
    one = _kept(sha256(json.dumps(content).encode()).hexdigest(), world.name_full)
    try:
        one.save(world, scene)
    except (OSError, RuntimeError) as error:
        raise LiveHandError(
            f"the world '{world.name}' must be saved to a temporary folder to read its light ({error}); "
            "free space there, or set Light to Capture's Own"
        ) from error
    return one


@lru_cache(maxsize=16)
def _kept(key: str, name: str) -> RenderedWorld:
    return RenderedWorld(name)


def _request(world: bpy.types.World, scene: bpy.types.Scene) -> dict[str, Any]:
    """Describe what to render: the world's name, the frame, and positions of objects whose coordinates nodes use."""
    return {
        "world": world.name,
        "frame": scene.frame_current_final,
        "threads": scene.render.threads if scene.render.threads_mode == "FIXED" else 0,
        "matrices": {one.name: [list(row) for row in one.matrix_world] for one in objects_of(world.node_tree)},
    }


def _save(world: bpy.types.World, request: dict[str, Any], folder: Path) -> None:
    """Save the world with all that it uses, the pixels that no file holds, and the request."""
    if world.library is None:
        blend = str(folder / "world.blend")
        bpy.data.libraries.write(blend, {world}, path_remap="ABSOLUTE", fake_user=True)
    else:  # Blender would write no more than its name
        blend = bpy.path.abspath(world.library.filepath)
    pixels = {}
    for number, image in enumerate(images_of(world.node_tree)):
        if image.is_dirty:
            values = np.empty(len(image.pixels), np.float32)
            image.pixels.foreach_get(values)
            pixels[image.name] = f"pixels{number}.npy"
            np.save(folder / pixels[image.name], values)
    document = json.dumps({**request, "blend": blend, "pixels": pixels})
    (folder / "request.json").write_text(document, encoding="utf-8")


def _render(name: str, folder: Path) -> WorldMap:
    out = folder / "map.npz"
    try:
        done = subprocess.run(
            [*_blender(), str(folder / "request.json"), str(out)],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_TIMEOUT_S,
            check=False,
        )
        fault = done.stderr.strip().splitlines()[-1:] or [f"exit status {done.returncode}"]
    except (OSError, subprocess.TimeoutExpired) as error:
        fault = [str(error)]
    if not out.is_file():
        raise LiveHandError(
            f"the world '{name}' must be rendered to read its light, its render failed ({fault[0]}); "
            "simplify its nodes, or set Light to Capture's Own"
        )
    with np.load(out) as arrays:
        return _world_map(name, arrays)


def _blender() -> list[str]:
    """Return the command that runs our script in a Blender like this one."""
    script = str(Path(__file__).with_name("world_render.py"))
    if bpy.app.binary_path:
        return [bpy.app.binary_path, "--background", "--factory-startup", "--python", script, "--"]
    return [sys.executable, "-P", script]  # Blender as a module; -P: our modules must not shadow others'


def _world_map(name: str, arrays: np.lib.npyio.NpzFile) -> WorldMap:
    radiance = arrays["radiance"].astype(np.float64)
    if not np.isfinite(radiance).all():
        raise LiveHandError(
            f"the world '{name}' must shine with finite radiance, got NaN or infinity; look for a division by zero in "
            "its nodes"
        )
    angle_rad = float(arrays["angle_rad"])
    close_ups = [
        CloseUp(pixels, axes, angle_rad) for pixels, axes in zip(arrays["close_ups"], arrays["axes"], strict=True)
    ]
    without, suns = extract_suns(np.maximum(radiance, 0), close_ups)
    return WorldMap(without, tuple(suns))
