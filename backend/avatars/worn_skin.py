"""What a path tracer needs to show the very person of an avatar: their skin as textures over the atlas, unlit.

An avatar holds its skin in parts: what its networks learnt, a factor on that, and detail by size. Here they are put
together, so that the captures' hand (`livehand_blender/capture`) can wear them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch.nn.functional import interpolate

from ..capture.person import Person
from ..hand.model import HandModel
from ..records.errors import LiveHandError
from ..surface.albedo_ratio import RATIO_ARRAY, RATIO_STEP
from ..surface.base_surface import whole_surface
from ..surface.detail_maps import DORSAL_SHADE, PALMAR_SHADE, PIGMENT_COLOUR
from ..surface.detail_maps_file import skin_detail_of
from ..surface.detail_surface import VEIN_STEP
from ..surface.stored_surface import StoredSurface
from .avatar import Avatar
from .network_albedo import FIELD_RESOLUTION, network_albedo

REFLECTANCE = 0.005, 0.01, 0.02, 0.035, 0.062, 0.095, 0.15, 0.2, 0.25, 0.35, 0.45, 0.56, 0.64, 0.755, 0.86, 0.95
BASE_COLOR = 0.0097, 0.0187, 0.037, 0.0614, 0.106, 0.151, 0.221, 0.276, 0.332, 0.44, 0.541, 0.644, 0.72, 0.81, 0.9, 0.98
"""What skin by Cycles' random walk reflects, and by which base color: of the skins that ship by their networks, all
channels alike; beyond them of a ball of that skin under an even sky."""


@dataclass(frozen=True)
class WornSkin:
    """A person's skin, the row of the smallest v first.

    Attributes:
        surface: with all of its arrays.
        base_color: [R, R, 3] linear, of a straight hand without the shade of its fine folds; by `BASE_COLOR`.
        heights: [R, R, 3] of relief, mm, and of folds and creases, 1 at the deepest.
        fold_shade: [R, R, 2] of folds and creases that the color lacks, as `shading_detail.FOLD_LOG_ALBEDO` counts it.
        gloss: [Q, Q, 2] roughness of the skin, and 1 on nails.
        vein: [N] where veins rise, at the vertices of the second subdivision.
    """

    surface: StoredSurface
    base_color: np.ndarray
    heights: np.ndarray
    fold_shade: np.ndarray
    gloss: np.ndarray
    vein: np.ndarray

    @property
    def person(self) -> Person:
        """Whose skin it is, in numbers."""
        return self.surface.person


def worn_skin(avatar: Avatar, hand: HandModel) -> WornSkin:
    """Put together the skin of an avatar's right hand.

    Args:
        avatar: relightable, with a surface.
        hand: its model.

    Raises:
        LiveHandError: the avatar has no surface, or is of another hand.
    """
    if avatar.surface is None or avatar.surface.hand_sha256 != hand.sha256:
        raise LiveHandError(
            f"the person must be of an avatar of '{hand.name}' with a surface, '{avatar.name}' is not; use one that "
            "ships, or of livehand person or new-person"
        )
    surface = whole_surface(avatar.surface)
    detail, melanin = skin_detail_of(surface.arrays), surface.person.melanin
    fine, coarse, resolution = detail.fine, detail.coarse, len(detail.fine.relief_mm)
    heights = (
        whole + _widened(wide[..., None], resolution)[..., 0]
        for whole, wide in (
            (fine.relief_mm, coarse.relief_mm),
            (fine.dorsal, coarse.dorsal),
            (fine.palmar, coarse.palmar),
        )
    )
    pigment = (1 - melanin) * fine.pigment_light + melanin * fine.pigment_deep
    colour = np.array(PIGMENT_COLOUR[0]) * (1 - melanin) + np.array(PIGMENT_COLOUR[1]) * melanin
    log_albedo = _widened(np.log(network_albedo(avatar, hand, FIELD_RESOLUTION).clip(1e-4)), resolution)
    if RATIO_ARRAY in surface.arrays:
        log_albedo = log_albedo + _widened(surface.arrays[RATIO_ARRAY] * np.float32(RATIO_STEP), resolution)
    return WornSkin(
        surface=surface,
        base_color=base_color(log_albedo + pigment[..., None] * colour.astype(np.float32)),
        heights=np.stack(list(heights), -1),
        fold_shade=np.stack([DORSAL_SHADE * fine.dorsal, PALMAR_SHADE * fine.palmar], -1),
        gloss=np.stack([detail.roughness, detail.nail], -1),
        vein=surface.arrays["vein"] * np.float32(VEIN_STEP),
    )


def base_color(log_reflectance: np.ndarray) -> np.ndarray:
    """Tell by which base color Cycles' skin reflects so much, of a logarithm."""
    log_color = np.interp(log_reflectance, np.log(REFLECTANCE), np.log(BASE_COLOR))
    return np.exp(log_color).astype(np.float32)


def _widened(image: np.ndarray, resolution: int) -> np.ndarray:
    """Interpolate [A, A, C] at another resolution."""
    values = torch.as_tensor(np.ascontiguousarray(image), dtype=torch.float32).permute(2, 0, 1)[None]
    return interpolate(values, size=(resolution, resolution), mode="bilinear")[0].permute(1, 2, 0).numpy()
