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
from ..surface.atlas_borders import split_atlas
from ..surface.atlas_texels import AtlasTexels
from ..surface.base_surface import whole_surface
from ..surface.blood import drains_of, place_log_albedo
from ..surface.detail_maps import DORSAL_SHADE, PALMAR_SHADE, PIGMENT_COLOUR, furrow_shade
from ..surface.detail_maps_file import ATLAS_MM, skin_detail_of
from ..surface.detail_surface import LEVELS, detail_surface_of
from ..surface.stored_surface import StoredSurface
from .avatar import Avatar
from .file import load_avatar
from .library import SKINS, shipped_avatar_path
from .network_albedo import FIELD_RESOLUTION, network_albedo

REFLECTANCE = 0.005, 0.01, 0.02, 0.035, 0.062, 0.095, 0.15, 0.2, 0.25, 0.35, 0.45, 0.56, 0.64, 0.755, 0.86, 0.95
BASE_COLOR = 0.0097, 0.0187, 0.037, 0.0614, 0.106, 0.151, 0.221, 0.276, 0.332, 0.44, 0.541, 0.644, 0.72, 0.81, 0.9, 0.98
"""What skin by Cycles' random walk reflects, and by which base color: of the skins that ship by their networks, all
channels alike; beyond them of a ball of that skin under an even sky."""
SCATTERED_IN_NAILS = 0.4
"""Share of light that is scattered under a nail; the rest is reflected at once."""
_REFLECTED_AT_ONCE = 0.95
_BLOOD_DRAWN_OUT = 0.7  # of joints, usually
_BLURS, _LEAST_SHARE = 120, 1e-6  # of a mean with neighbours .75 to 1 mm away, which have a deviation of some 5 mm


@dataclass(frozen=True)
class WornTextures:
    """A person's skin, the row of the smallest v first.

    Attributes:
        surface: with all of its arrays.
        reflectance: [R, R, 3] linear, of a straight hand without the shade of its fine folds.
        network_albedo: [B, B, 3] what the avatar's networks show of it.
        texels: of that map.
        trained_on: whom the networks know.
        heights: [R, R, 3] of relief, mm, and of folds and creases, 1 at the deepest.
        fold_shade: [R, R, 2] of folds and creases that the color lacks, as `shading_detail.FOLD_LOG_ALBEDO` counts it.
        gloss: [Q, Q, 2] roughness of the skin, and 1 on nails.
        vein, padding_mm: [N] where veins rise and how high flesh does, at the vertices of the second subdivision.
        drains: [N] blood that leaves where bending makes the skin tight (`surface.blood`), at these; None: none.
    """

    surface: StoredSurface
    reflectance: np.ndarray
    network_albedo: np.ndarray
    texels: AtlasTexels
    trained_on: Person
    heights: np.ndarray
    fold_shade: np.ndarray
    gloss: np.ndarray
    vein: np.ndarray
    padding_mm: np.ndarray
    drains: np.ndarray | None

    @property
    def person(self) -> Person:
        """Whose skin it is, in numbers."""
        return self.surface.person

    @property
    def joint_log_color(self) -> np.ndarray:
        """By how much [3] blood of 1 changes the logarithm of the base color of such skin."""
        log_albedo = place_log_albedo(self.person.melanin)
        usual = np.log(np.median(self.reflectance.reshape(-1, 3), 0))
        paler = _looked_up(usual - _BLOOD_DRAWN_OUT * log_albedo, REFLECTANCE)
        return (np.log(_looked_up(usual, REFLECTANCE)) - np.log(paler)) / _BLOOD_DRAWN_OUT

    def base_color(self, trained_color: np.ndarray, trained_nail: np.ndarray) -> np.ndarray:
        """Compute the base color [R, R, 3] by which Cycles' skin shows this person.

        Networks show a fold of the palm or a thin finger brighter or darker than an endless flat skin of that color,
        as it is. What they show of the person whom they know, against that person's color, tells by how much; of nails
        it does not, which reflect by another law and may be longer.

        Args:
            trained_color: [B, B, 3] base color of the person whom the networks know; black beside the skin.
            trained_nail: [B, B] whether a texel is nail.
        """
        is_skin = (trained_color.sum(-1) > 1e-3) & ~trained_nail
        flat = np.exp(np.interp(np.log(trained_color.clip(1e-4)), np.log(BASE_COLOR), np.log(REFLECTANCE)))
        excess = np.where(is_skin[..., None], np.log(self.network_albedo.clip(1e-4)) - np.log(flat), 0)
        resolution = len(self.reflectance)
        nail = _widened(self.gloss[..., 1:], resolution)
        brighter = _widened(_smoothed(self.texels, excess, is_skin), resolution)
        log_reflectance = np.log(self.reflectance) - (1 - nail) * brighter
        return (1 - nail) * _looked_up(log_reflectance, REFLECTANCE) + nail * _looked_up(log_reflectance, _OF_NAILS)


_OF_NAILS = tuple(
    SCATTERED_IN_NAILS * flat + (1 - SCATTERED_IN_NAILS) * _REFLECTED_AT_ONCE * color
    for flat, color in zip(REFLECTANCE, BASE_COLOR, strict=True)
)


def worn_textures(avatar: Avatar, hand: HandModel) -> WornTextures:
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
    surface, shown = whole_surface(avatar.surface), network_albedo(avatar, hand, FIELD_RESOLUTION)
    detail, melanin = skin_detail_of(surface.arrays), surface.person.melanin
    raised = detail_surface_of(surface.arrays).raised
    fine, coarse, resolution = detail.fine, detail.coarse, len(detail.fine.relief_mm)
    pairs = (fine.relief_mm, coarse.relief_mm), (fine.dorsal, coarse.dorsal), (fine.palmar, coarse.palmar)
    pigment = (1 - melanin) * fine.pigment_light + melanin * fine.pigment_deep
    pigment = pigment + furrow_shade(fine.relief_mm, ATLAS_MM / resolution)
    colour = (1 - melanin) * np.array(PIGMENT_COLOUR[0]) + melanin * np.array(PIGMENT_COLOUR[1])
    log_reflectance = _widened(np.log(shown.clip(1e-4)), resolution) + pigment[..., None] * colour.astype(np.float32)
    if RATIO_ARRAY in surface.arrays:
        log_reflectance += _widened(surface.arrays[RATIO_ARRAY] * np.float32(RATIO_STEP), resolution)
    return WornTextures(
        surface=surface,
        reflectance=np.exp(log_reflectance),
        network_albedo=shown,
        texels=_texels_of(hand, len(shown)),
        trained_on=_trained_on(avatar),
        heights=np.stack([narrow + _widened(wide[..., None], resolution)[..., 0] for narrow, wide in pairs], -1),
        fold_shade=np.stack([DORSAL_SHADE * fine.dorsal, PALMAR_SHADE * fine.palmar], -1),
        gloss=np.stack([detail.roughness, detail.nail], -1),
        vein=raised.vein,
        padding_mm=raised.padding_mm,
        drains=drains_of(surface.arrays),
    )


def _texels_of(hand: HandModel, resolution: int) -> AtlasTexels:
    faces, corner_uv = split_atlas(hand.f, hand.vt[hand.ft], LEVELS)
    return AtlasTexels.of(torch.as_tensor(corner_uv, dtype=torch.float32), torch.as_tensor(faces), resolution)


def _trained_on(avatar: Avatar) -> Person:
    """Find the person whom an avatar's networks know: one that ships, or else its own."""
    assert avatar.surface is not None
    own = avatar.superres.state_dict()
    for skin in SKINS:
        shipped = load_avatar(shipped_avatar_path(skin))
        theirs = shipped.superres.state_dict()
        if own.keys() == theirs.keys() and all(torch.equal(own[key], theirs[key]) for key in own) and shipped.surface:
            return shipped.surface.person
    return avatar.surface.person


def _looked_up(log_reflectance: np.ndarray, reflectance: tuple[float, ...]) -> np.ndarray:
    return np.exp(np.interp(log_reflectance, np.log(reflectance), np.log(BASE_COLOR))).astype(np.float32)


def _smoothed(texels: AtlasTexels, values: np.ndarray, is_skin: np.ndarray) -> np.ndarray:
    """Blur values [B, B, C] of an atlas over the surface's skin alone, whatever charts it is cut into."""
    means, found = texels.at_vertices(texels.from_map(values), texels.from_map(is_skin)[:, 0].astype(float))
    sums = np.column_stack([means * found[:, None], found])
    degree = texels.laplacian.diagonal()[:, None]
    for _ in range(_BLURS):
        sums = sums - 0.5 * (texels.laplacian @ sums) / degree
    blurred = sums[:, :-1] / sums[:, -1:].clip(_LEAST_SHARE)
    return texels.as_map(texels.at_texels(blurred).astype(np.float32))


def _widened(image: np.ndarray, resolution: int) -> np.ndarray:
    """Interpolate [A, A, C] at another resolution."""
    values = torch.as_tensor(np.ascontiguousarray(image), dtype=torch.float32).permute(2, 0, 1)[None]
    return interpolate(values, size=(resolution, resolution), mode="bilinear")[0].permute(1, 2, 0).numpy()
