"""An invented person's surface from the drawn maps: bands of relief and folds, veins, and the ratio of albedos.

What is coarser than networks resolve is in the ratio to the base's albedo; what is finer is in the detail maps
(`surface/detail_maps_file.py`), whose coarse pigment stays the base's: it is what the base's own rays pass over.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from torch.nn.functional import avg_pool2d, conv2d, interpolate

from ...hand.model import HandModel
from ..atlas_texels import AtlasTexels
from ..blood import DRAIN_STEP, DRAINS
from ..detail_maps_file import (
    ATLAS_MM,
    COARSEST_MM,
    FOLD_STEP,
    NAIL_STEP,
    PIGMENT_STEP,
    RELIEF_STEP_MM,
    WIDEST_MM,
)
from ..detail_mesh import DetailTemplate
from ..detail_surface import HEIGHT_STEP_MM, PADDING, VEIN_STEP, PoseForm, load_detail_surface
from .drawn_albedo import drawn_log_albedo, joint_blood, with_folds
from .drawn_forms import drawn_padding_mm, drawn_veins, rounded_valleys_mm, web_forms
from .drawn_relief import drawn_relief
from .hand_chart import HandChart, smoothstep
from .look import PersonLook
from .skin_lines import PlaneImage, veins
from .solid_noise import SolidNoise

_COARSER = 4  # texels of the fine maps that make one of the coarse, along each side
_VEINS, _HAIR = 31, 32  # purposes of random numbers
_HAIR_STEP = 1 / 32
_FILLED_MM = 0.5, 0.1  # from what fills a valley on, none of the base's slopes are left in it; and up to what all are


class AtlasSizes(NamedTuple):
    """Texels along the atlas of the fine maps, and of the ratio."""

    fine: int = 2048
    ratio: int = 1024


class DrawnPerson(NamedTuple):
    """What was drawn.

    Attributes:
        arrays: of the surface, by the names of `stored_surface.ARRAYS`, without the ratio.
        log_albedo: [A, A, 3], spread beyond the charts.
    """

    arrays: dict[str, np.ndarray]
    log_albedo: np.ndarray


def drawn_person(hand: HandModel, look: PersonLook, base: dict[str, np.ndarray], sizes: AtlasSizes) -> DrawnPerson:
    """Draw a person's skin on the built-in hand.

    Args:
        hand: the right one.
        look: of the person.
        base: arrays of the base surface.
        sizes: of the maps.
    """
    surface = load_detail_surface(hand.sha256)
    assert surface is not None
    template = DetailTemplate.of(surface, hand)
    lines = veins(look.random(_VEINS))
    arrays = _relief_arrays(template, look, sizes.fine)
    vertices = HandChart.at_vertices(template)
    arrays["vein"] = _steps(drawn_veins(vertices, lines), VEIN_STEP, np.int8).clip(0, 100)
    flesh_mm = drawn_padding_mm(vertices, look)
    padding_mm = rounded_valleys_mm(template, vertices, flesh_mm)
    arrays["unresolved"] = _unresolved(template, base["unresolved"], padding_mm - flesh_mm)
    arrays[PADDING] = _steps(padding_mm, HEIGHT_STEP_MM, np.int8)
    arrays[DRAINS] = _steps(joint_blood(vertices, look), DRAIN_STEP, np.uint8)
    arrays |= _form_arrays(base, web_forms(vertices))
    arrays["hair/share"] = _hair_share(template, look, base["hair/share"])
    return DrawnPerson(arrays, _log_albedo(template, look, lines, sizes.ratio))


def _relief_arrays(template: DetailTemplate, look: PersonLook, resolution: int) -> dict[str, np.ndarray]:
    texels = AtlasTexels.of(template.corner_uv, template.faces, resolution)
    relief = drawn_relief(HandChart.at_texels(template, texels), look)
    bands = _Bands.of(texels)
    steps = {"relief": RELIEF_STEP_MM, "dorsal": FOLD_STEP, "palmar": FOLD_STEP}
    maps = {"relief": relief.relief_mm, "dorsal": relief.dorsal, "palmar": relief.palmar}
    arrays = {}
    for name, values in maps.items():
        for level, band in zip(("fine", "coarse"), bands.split(values), strict=True):
            arrays[f"{level}/{name}"] = _steps(band, steps[name], np.int8)
    pigment = _steps(bands.split(relief.fine_pigment)[0], PIGMENT_STEP, np.int8)
    arrays |= {"fine/pigment_light": pigment, "fine/pigment_deep": pigment}
    arrays["nail"] = _steps(bands.coarse(smoothstep(relief.nail_rim, 0.97, 0.90)), NAIL_STEP, np.int8)
    return arrays


def _form_arrays(base: dict[str, np.ndarray], own: tuple[PoseForm, ...]) -> dict[str, np.ndarray]:
    """Return the arrays of the base's forms and of a person's own."""
    added = {
        "form/joint": [form.joint for form in own],
        "form/range_deg": [(form.start_deg, form.full_deg) for form in own],
        "form/height": [_steps(form.height_mm, HEIGHT_STEP_MM, np.int8) for form in own],
    }
    return {name: np.concatenate([base[name], np.array(rows, base[name].dtype)]) for name, rows in added.items()}


def _log_albedo(template: DetailTemplate, look: PersonLook, lines: PlaneImage, resolution: int) -> np.ndarray:
    texels = AtlasTexels.of(template.corner_uv, template.faces, resolution)
    chart = HandChart.at_texels(template, texels)
    relief = drawn_relief(chart, look)
    coarse = _Bands.of(texels).blurred
    smooth = replace(relief, furrow=coarse(relief.furrow))
    skin = drawn_log_albedo(chart, smooth, lines.at(chart.points_mm), look)
    return texels.as_map(with_folds(skin, coarse(relief.dorsal), coarse(relief.palmar)))


def _unresolved(template: DetailTemplate, base: np.ndarray, filled_mm: np.ndarray) -> np.ndarray:
    """Return the slopes [2, U, U] that the surface's normals lack: the base's, but where a valley is filled none."""
    texels = AtlasTexels.of(template.corner_uv, template.faces, base.shape[-1])
    kept = texels.as_map(texels.at_texels(smoothstep(filled_mm, *_FILLED_MM)[:, None]))[..., 0]
    return np.round(kept * base).astype(base.dtype)


def _hair_share(template: DetailTemplate, look: PersonLook, base: np.ndarray) -> np.ndarray:
    """Return where hairs grow [M, H]: as on the base, by patches of the person's own."""
    centre = 1e3 * template.rest_vertices().numpy()[template.faces.numpy()].mean(1)
    patches = SolidNoise.of(look.random(_HAIR)).smooth(centre.astype(np.float32), 12.0, 2)
    share = base * (0.75 + 0.25 * patches.clip(-1, 1))[:, None]
    return ((share / _HAIR_STEP).round() * _HAIR_STEP).clip(0, 1).astype(np.float32)


class _Bands(NamedTuple):
    """Splits a map into what is finer and what is coarser than networks resolve.

    Attributes:
        texels: of the map.
        share: [1, 1, n, n] of the coarse texels that is skin.
    """

    texels: AtlasTexels
    share: torch.Tensor

    @classmethod
    def of(cls, texels: AtlasTexels) -> _Bands:
        return cls(texels, avg_pool2d(_plane(texels, np.ones(len(texels.pixel), np.float32)), _COARSER))

    def split(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Split values [T] into a fine map [N, N] and a coarse one [N / 4, N / 4]."""
        small, wide = self._smooth(values, COARSEST_MM), self._smooth(values, WIDEST_MM)
        return self._spread(values - self._at_texels(small)), (small - wide)[0, 0].numpy()

    def blurred(self, values: np.ndarray) -> np.ndarray:
        """Blur values [T] to what networks resolve."""
        return self._at_texels(self._smooth(values, COARSEST_MM))

    def coarse(self, values: np.ndarray) -> np.ndarray:
        """Average values [T] over the coarse texels [N / 4, N / 4]."""
        return avg_pool2d(torch.from_numpy(self._spread(values))[None], _COARSER)[0].numpy()

    def _spread(self, values: np.ndarray) -> np.ndarray:
        """Return values [T] as a map [N, N] that goes on beyond the charts, so that their borders are no steps."""
        return self.texels.as_map(values[:, None].astype(np.float32))[..., 0]

    def _smooth(self, values: np.ndarray, deviation_mm: float) -> torch.Tensor:
        deviation = deviation_mm * self.share.shape[-1] / ATLAS_MM
        sums = _gaussian(avg_pool2d(_plane(self.texels, values), _COARSER), deviation)
        return sums / _gaussian(self.share, deviation).clamp(min=1e-4)

    def _at_texels(self, coarse: torch.Tensor) -> np.ndarray:
        size = (self.texels.resolution,) * 2
        return interpolate(coarse, size=size, mode="bilinear")[0, 0].numpy().ravel()[self.texels.pixel]


def _plane(texels: AtlasTexels, values: np.ndarray) -> torch.Tensor:
    image = np.zeros(texels.resolution**2, np.float32)
    image[texels.pixel] = values
    return torch.from_numpy(image.reshape(1, 1, texels.resolution, -1))


def _gaussian(image: torch.Tensor, deviation: float) -> torch.Tensor:
    reach = int(3 * deviation + 1)
    weight = torch.exp(-0.5 * (torch.arange(-reach, reach + 1) / deviation) ** 2)
    weight = weight / weight.sum()
    along = conv2d(image, weight.reshape(1, 1, 1, -1), padding=(0, reach))
    return conv2d(along, weight.reshape(1, 1, -1, 1), padding=(reach, 0))


def _steps(values: np.ndarray, step: float, kind: type[np.integer]) -> np.ndarray:
    limits = np.iinfo(kind)
    return np.round(values / step).clip(max(limits.min, -limits.max), limits.max).astype(kind)
