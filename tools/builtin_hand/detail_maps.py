"""Makes the maps of the skin's fine detail (`backend/surface/detail_maps_file.py`) from the skin that captures show.

The command line below needs bpy, takes some minutes and writes the two files that ship beside the hand.

    python -m livehand.tools.builtin_hand.detail_maps FOLDER
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from ...backend.capture.person import PERSONS, Person
from ...backend.hand.model import HandModel
from ...backend.hand.model_file import load_default_hand
from ...backend.surface.base_surface import COARSE_FILE, FINE_FILE
from ...backend.surface.detail_maps_file import (
    ATLAS_MM,
    COARSEST_MM,
    FOLD_STEP,
    NAIL_STEP,
    PIGMENT_STEP,
    RELIEF_STEP_MM,
    ROUGHNESS_STEP,
    SLOPE_STEP,
    WIDEST_MM,
)
from ...backend.system.readers import npz_bytes
from ...backend.teacher.dependencies import needs
from ...backend.teacher.detailed_surface import DetailedSurface, detailed_surface
from ...livehand_blender.capture.bake import bake_mask, bake_skin
from ...livehand_blender.capture.scene import capture_scene
from ...livehand_blender.capture.skin import SkinTone
from ...livehand_blender.capture.surface import SkinSurface
from .unresolved_slopes import unresolved_slopes

with needs("scipy"):
    from scipy.ndimage import gaussian_filter

_LEAST_ALBEDO = 1e-3  # what no chart covers is black
_STEPS = {
    "relief": RELIEF_STEP_MM,
    "dorsal": FOLD_STEP,
    "palmar": FOLD_STEP,
    "pigment_light": PIGMENT_STEP,
    "pigment_deep": PIGMENT_STEP,
}
NAIL_RIM = (0.97, 0.90)
"""Of the mask `nailrim`: where nails begin to shine, and where they do; the slopes of their rims would glitter."""
COARSER = 4
"""How many texels of the fine maps make one of the coarse, along each side."""
# Freckles differ from person to person, and are large enough for an avatar's own planes.
_LIGHT, _DEEP = (replace(PERSONS[name], freckles=0.0) for name in ("light", "deep"))


def blurred(values: np.ndarray, is_skin: np.ndarray, texels: float) -> np.ndarray:
    """Compute [N, N] Gaussian blur of this deviation over the skin alone; 0 beside the skin."""
    weight = gaussian_filter(is_skin.astype(np.float32), texels)
    total = gaussian_filter(np.where(is_skin, values, 0).astype(np.float32), texels)
    return np.where(is_skin, total / np.maximum(weight, 1e-6), 0)


def fine_part(values: np.ndarray, is_skin: np.ndarray, coarsest_texels: float) -> np.ndarray:
    """Subtract from [N, N] its blur of this deviation; 0 beside the skin."""
    return np.where(is_skin, values - blurred(values, is_skin, coarsest_texels), 0)


def coarse_part(values: np.ndarray, is_skin: np.ndarray, coarsest_texels: float, widest_texels: float) -> np.ndarray:
    """Subtract one deviation's blur from the other's, [N / 4, N / 4]; 0 beside the skin."""
    share = _blocks(is_skin.astype(np.float32))
    small = _blocks(blurred(values, is_skin, coarsest_texels)) / np.maximum(share, 1e-6)
    return fine_part(small, share > 0.5, widest_texels / COARSER)


def skin_detail_arrays(
    model: HandModel, light: dict[str, np.ndarray], deep: dict[str, np.ndarray]
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Encode the arrays of both files, fine and coarse, from maps [N, N, 3] of a light and a deep skin (`_baked`)."""
    is_skin = light["albedo"].sum(-1) > _LEAST_ALBEDO
    texel_mm = ATLAS_MM / len(is_skin)
    coarsest, widest = COARSEST_MM / texel_mm, WIDEST_MM / texel_mm
    maps = _maps(light, deep)
    surface = detailed_surface(model, levels=0)
    bend = {"joint": surface.masks["jid"].astype(np.int8)}
    fine = {name: fine_part(values, is_skin, coarsest) for name, values in maps.items()}
    coarse = {name: coarse_part(values, is_skin, coarsest, widest) for name, values in maps.items()}
    nail = _steps(nail_part(light["nailrim"][..., 0], is_skin), NAIL_STEP)
    roughness = _steps(roughness_part(light["mask"][..., 0], is_skin), ROUGHNESS_STEP)
    return _whole_steps(fine) | bend, _whole_steps(coarse) | {"nail": nail, "roughness": roughness}


def nail_part(rim: np.ndarray, is_skin: np.ndarray) -> np.ndarray:
    """Mark where the skin is nail, [N / 4, N / 4] from 0 to 1, by the mask `nailrim`."""
    outer, inner = NAIL_RIM
    inside = np.clip((rim - outer) / (inner - outer), 0, 1)
    return _blocks(np.where(is_skin, inside * inside * (3 - 2 * inside), 0))


def roughness_part(roughness: np.ndarray, is_skin: np.ndarray) -> np.ndarray:
    """Average over the skin, [N / 4, N / 4]; beside it, the mean of all."""
    share = _blocks(is_skin.astype(np.float32))
    mean = _blocks(np.where(is_skin, roughness, 0)) / np.maximum(share, 1e-6)
    return np.where(share > 0, mean, roughness[is_skin].mean())


def _maps(light: dict[str, np.ndarray], deep: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Convert each [N, N] to the units of `SkinMaps`."""
    pigments = (np.log(np.maximum(maps["albedo"], _LEAST_ALBEDO)).mean(-1) for maps in (light, deep))
    return dict(zip(_STEPS, (*np.moveaxis(light["height"], -1, 0), *pigments), strict=True))


def _blocks(values: np.ndarray) -> np.ndarray:
    """Average over blocks."""
    count = len(values) // COARSER
    return values.reshape(count, COARSER, count, COARSER).mean((1, 3))


def _whole_steps(maps: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name: _steps(values, _STEPS[name]) for name, values in maps.items()}


def _steps(values: np.ndarray, step: float) -> np.ndarray:
    return np.clip(np.round(values / step), -127, 127).astype(np.int8)


def _baked(model: HandModel, detail: DetailedSurface, person: Person) -> dict[str, np.ndarray]:
    surface = SkinSurface.create(model, detail, person.veins_mm)
    with tempfile.TemporaryDirectory() as folder:
        paths = bake_skin(surface.object, Path(folder), SkinTone.of(person))
        paths["nailrim"] = Path(folder) / "nailrim.exr"
        bake_mask(surface.object, "nailrim", paths["nailrim"])
        maps = {name: _read(paths[name]) for name in ("albedo", "height", "mask", "nailrim")}
    bpy.data.objects.remove(surface.object)
    return maps


def _read(path: Path) -> np.ndarray:
    """Read [N, N, 3] with the row of the smallest v first, as Blender keeps it."""
    image = bpy.data.images.load(str(path))
    width, height = image.size
    values = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(values)
    bpy.data.images.remove(image)
    return values.reshape(height, width, 4)[..., :3]


def main() -> None:
    """Bake both skins and write both files."""
    parser = argparse.ArgumentParser(description="Make the maps of the built-in skin's fine detail.")
    parser.add_argument("folder", type=Path, help="where to write both files")
    folder = parser.parse_args().folder
    model = load_default_hand()
    capture_scene(None)
    surface = detailed_surface(model)
    fine, coarse = skin_detail_arrays(model, _baked(model, surface, _LIGHT), _baked(model, surface, _DEEP))
    coarse["unresolved"] = _steps(unresolved_slopes(model, surface, 2 * len(coarse["nail"])), SLOPE_STEP)
    (folder / FINE_FILE).write_bytes(npz_bytes(fine))
    (folder / COARSE_FILE).write_bytes(npz_bytes(coarse))


if __name__ == "__main__":
    main()
