"""Makes the maps of the built-in skin's fine detail (`backend/hand/skin_detail.py`) from the skin that captures show.

The command line below needs bpy, takes some minutes and writes the file that ships beside the hand.

    python -m livehand.livehand_blender.capture.skin_detail OUT.npz
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from ...backend.captures.person import PERSONS, Person
from ...backend.hand.builtin.dependencies import needs
from ...backend.hand.builtin.detailed_surface import DetailedSurface, detailed_surface
from ...backend.hand.model import HandModel
from ...backend.hand.model_file import load_default_hand
from ...backend.hand.skin_detail import (
    ATLAS_MM,
    COARSEST_MM,
    FOLD_STEP,
    PIGMENT_STEP,
    RELIEF_STEP_MM,
    write_skin_detail,
)
from .bake import bake_mask, bake_skin
from .scene import capture_scene
from .skin import SkinTone
from .surface import SkinSurface

with needs("scipy"):
    from scipy.ndimage import gaussian_filter

_LEAST_ALBEDO = 1e-3  # what no chart covers is black
# Freckles differ from person to person, and are large enough for an avatar's own planes.
_LIGHT, _DEEP = (replace(PERSONS[name], freckles=0.0) for name in ("light", "deep"))


def fine_part(values: np.ndarray, is_skin: np.ndarray, coarsest_texels: float) -> np.ndarray:
    """[N, N] minus a Gaussian blur of this deviation over the skin alone; 0 beside the skin."""
    weight = gaussian_filter(is_skin.astype(np.float32), coarsest_texels)
    blurred = gaussian_filter(np.where(is_skin, values, 0).astype(np.float32), coarsest_texels)
    return np.where(is_skin, values - blurred / np.maximum(weight, 1e-6), 0)


def skin_detail_arrays(
    model: HandModel, light: dict[str, np.ndarray], deep: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """The arrays of the file, from the maps of a light and of a deep skin: `height`, `albedo` and `vein` [N, N, 3]."""
    is_skin = light["albedo"].sum(-1) > _LEAST_ALBEDO
    coarsest = COARSEST_MM / (ATLAS_MM / len(is_skin))
    relief, dorsal, palmar = (fine_part(light["height"][..., k], is_skin, coarsest) for k in range(3))
    pigments = [
        fine_part(np.log(np.maximum(maps["albedo"], _LEAST_ALBEDO)).mean(-1), is_skin, coarsest)
        for maps in (light, deep)
    ]
    coarse = detailed_surface(model, levels=0)
    return {
        "relief": _steps(relief, RELIEF_STEP_MM),
        "dorsal": _steps(dorsal, FOLD_STEP),
        "palmar": _steps(palmar, FOLD_STEP),
        "veins": _steps(fine_part(light["vein"][..., 0], is_skin, coarsest), FOLD_STEP),
        "pigment_light": _steps(pigments[0], PIGMENT_STEP),
        "pigment_deep": _steps(pigments[1], PIGMENT_STEP),
        "joint": coarse.masks["jid"].astype(np.int8),
        "flexion": coarse.flex_axis.astype(np.float32),
    }


def _steps(values: np.ndarray, step: float) -> np.ndarray:
    return np.clip(np.round(values / step), -127, 127).astype(np.int8)


def _baked(model: HandModel, detail: DetailedSurface, person: Person) -> dict[str, np.ndarray]:
    surface = SkinSurface.create(model, detail, person.veins_mm)
    with tempfile.TemporaryDirectory() as folder:
        paths = bake_skin(surface.object, Path(folder), SkinTone.of(person))
        paths["vein"] = Path(folder) / "vein.exr"
        bake_mask(surface.object, "vein", paths["vein"])
        maps = {name: _read(paths[name]) for name in ("albedo", "height", "vein")}
    bpy.data.objects.remove(surface.object)
    return maps


def _read(path: Path) -> np.ndarray:
    """[N, N, 3] with the row of the smallest v first, as Blender keeps it."""
    image = bpy.data.images.load(str(path))
    width, height = image.size
    values = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(values)
    bpy.data.images.remove(image)
    return values.reshape(height, width, 4)[..., :3]


def main() -> None:
    """Command line: bake both skins and write the file."""
    parser = argparse.ArgumentParser(description="Make the maps of the built-in skin's fine detail.")
    parser.add_argument("out", type=Path, help="the .npz to write")
    out = parser.parse_args().out
    model = load_default_hand()
    capture_scene(None)
    detail = detailed_surface(model)
    write_skin_detail(out, skin_detail_arrays(model, _baked(model, detail, _LIGHT), _baked(model, detail, _DEEP)))


if __name__ == "__main__":
    main()
