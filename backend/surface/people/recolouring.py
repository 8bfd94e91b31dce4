"""Drawn blood, pigment and nails on the base's own relief, for people whose networks were trained on that.

Their folds, creases, veins and nails stay where the base has them, and only the ratio of albedos is new.
"""

from __future__ import annotations

import numpy as np
import torch
from torch.nn.functional import interpolate

from ...hand.model import HandModel
from ..atlas_texels import AtlasTexels
from ..base_surface import COARSE_FILE, FINE_FILE, SURFACE_FILE, base_arrays
from ..detail_maps_file import FOLD_STEP
from ..detail_mesh import DetailTemplate
from ..detail_surface import VEIN_STEP, load_detail_surface
from .drawn_albedo import drawn_log_albedo, with_folds
from .drawn_relief import BASE_NAIL_EXPONENTS, DrawnRelief, nail_shape
from .drawn_surface import albedo_ratio_arrays
from .hand_chart import HandChart
from .look import PersonLook

_FOLDS = "dorsal", "palmar"


def recoloured_arrays(
    hand: HandModel, look: PersonLook, network_albedo: np.ndarray, resolution: int
) -> dict[str, np.ndarray]:
    """Draw the array of a surface that gives a person of the base's relief the colours of a look.

    Args:
        hand: the built-in right one.
        look: of the person; what it says of relief, hair and shape is not used.
        network_albedo: [B, B, 3] of the person's networks.
        resolution: texels along the ratio's map.
    """
    surface = load_detail_surface(hand.sha256)
    assert surface is not None
    template = DetailTemplate.of(surface, hand)
    texels = AtlasTexels.of(template.corner_uv, template.faces, resolution)
    chart, base = HandChart.at_texels(template, texels), base_arrays(SURFACE_FILE, FINE_FILE, COARSE_FILE)
    coarse, fine = ({fold: _at(texels, base[f"{level}/{fold}"]) for fold in _FOLDS} for level in ("coarse", "fine"))
    dorsal, palmar = ((coarse[fold] + fine[fold]).clip(0) for fold in _FOLDS)
    none = np.zeros_like(dorsal)
    relief = DrawnRelief(none, dorsal, palmar, none, nail_shape(chart, BASE_NAIL_EXPONENTS).rim, none)
    vein = texels.at_texels(base["vein"][:, None] * np.float32(VEIN_STEP))[:, 0]
    skin = drawn_log_albedo(chart, relief, vein, look)
    return albedo_ratio_arrays(texels.as_map(with_folds(skin, coarse["dorsal"], coarse["palmar"])), network_albedo)


def _at(texels: AtlasTexels, steps: np.ndarray) -> np.ndarray:
    """Take a stored map of folds at the texels [T]."""
    image = torch.as_tensor(steps, dtype=torch.float32)[None, None] * FOLD_STEP
    size = (texels.resolution,) * 2
    return texels.from_map(interpolate(image, size=size, mode="bilinear", antialias=True)[0, 0].numpy())[:, 0]
