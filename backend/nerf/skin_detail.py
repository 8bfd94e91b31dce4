"""The fine detail of a known skin on a lit image: bump mapping at full size (Blinn 1978).

The rays of a relightable field tell colour and normal at half the image's size and to the resolution of its planes.
Folds, lines and the rims of nails are finer; where they are known (`hand.skin_detail`) they bend the normals of the
full-size image, in which lamps and gloss are evaluated, and darken its coefficients. From afar, where rays lie farther
apart than the planes resolve, what they pass over is added too. Nails shine in the narrower lobe alone: they are too
small a part of a hand for training to find that out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import avg_pool2d, conv2d, grid_sample, interpolate, normalize

from ..geometry.mesh import PosedMesh, Topology
from ..geometry.rasterise import rasterise
from ..hand.skin_detail import ATLAS_MM, COARSEST_MM, SkinDetail, SkinMaps
from .lighting import DIFFUSE, GLOSS, SCATTERED
from .rays import HandInView, project
from .relighting import LitImage

DORSAL_MM, PALMAR_MM = 0.36, 0.55
"""Depth of folds and creases at their deepest, straight and half bent."""
DORSAL_SHADE, PALMAR_SHADE = 0.42, 0.45
"""Share of the colour of folds at their deepest."""
FLATTENED, DEEPENED_FROM, DEEPENED_BY = 0.95, 0.75, 0.5
"""What bending a joint takes from the folds on its back, and what it makes of the creases below."""
FOLD_LOG_ALBEDO = (-0.45, -0.65, -0.60)
"""Logarithm of the colour of folds over that of the skin around them."""
BUMP = 0.6
"""Share of the slopes that shows: light is scattered inside the skin and leaves beside where it entered."""
FOLDS = 1.7
"""How much more shows of folds, which are wider than the way of light in the skin."""
TINT, COARSE_TINT = 0.5, 1.0
"""Shares of the pigment and of the colour of folds, fine and coarse: the rest is in an avatar's own planes."""
RESOLVED_PX = 1.5
"""Deviation of the blur beyond which the rays, two pixels apart, show all."""
LEAST_COSINE = 0.25
"""Of face and view: flatter views are filtered, and displaced, as this one."""
PLACE_STEPS = 2
"""Times that the skin's offset is read, each time where the last one led."""
SLOPE_STEP_MM, SHADE_STEP = 0.001, 0.01
"""What one step of the stored whole numbers is worth: slopes in mm a texel."""
CHANNELS = 10
"""Slopes along u and v of relief, dorsal folds and palmar creases; pigment; dorsal folds; palmar creases; nail."""
_SHADES = slice(6, 9)
_STEPS = [SLOPE_STEP_MM] * 6 + [SHADE_STEP] * 4
_LEVELS = 6
_BLUR_REACH = 3  # deviations
_TINY = 1e-12


class SkinLook(NamedTuple):
    """A person's skin.

    Attributes:
        melanin: 0 light to 1 deep.
        folds: depth of folds; 1 is a young adult's.
        veins_mm: height of veins.
    """

    melanin: float
    folds: float
    veins_mm: float


class DetailMaps(NamedTuple):
    """A person's detail as a pyramid of maps, each level half as wide as the one before.

    Attributes:
        table: [T, 10] int8: the texels of all levels, rows of the finest first, the smallest v first.
        resolution: of the finest level.
        texel_m: its texels' side, template metres.
        offset: [M, M, 3] where the skin lies beside the flat faces: along u and v of the atlas, and m above (template).
    """

    table: Tensor
    resolution: int
    texel_m: float
    offset: Tensor

    @classmethod
    def of(cls, detail: SkinDetail, look: SkinLook, device: torch.device | str = "cpu") -> DetailMaps:
        """The maps of a person.

        Args:
            detail: of the hand.
            look: of the person.
            device: of the table.
        """
        resolution = len(detail.fine.relief_mm)
        fine = _channels(detail.fine, look, 1.0)
        coarse = _channels(detail.coarse, look, len(detail.coarse.relief_mm) / resolution)
        coarse[_SHADES] = [COARSE_TINT / TINT * shade for shade in coarse[_SHADES]]
        columns = [_pyramid(*maps) for maps in zip(fine, coarse, _STEPS[:-1], strict=True)]
        columns.append(_mask_pyramid(detail.nail, resolution))
        offset = torch.as_tensor(detail.offset_mm, dtype=torch.float32) / torch.tensor([ATLAS_MM, ATLAS_MM, 1000.0])
        return cls(torch.stack(columns, 1).to(device), resolution, ATLAS_MM / 1000 / resolution, offset.to(device))

    @property
    def levels(self) -> list[tuple[int, int]]:
        """(first row of the table, resolution) of each level."""
        sizes = [self.resolution >> level for level in range(_LEVELS)]
        return [(sum(size**2 for size in sizes[:level]), sizes[level]) for level in range(_LEVELS)]

    def sample(self, uv: Float[Tensor, "P 2"], level: Float[Tensor, " P"]) -> Float[Tensor, "P 10"]:
        """Trilinear, in mm a texel, logarithms, and 1 on nails."""
        fine = level.clamp(0, _LEVELS - 1).floor().long()
        share = (level.clamp(0, _LEVELS - 1) - fine)[:, None]
        coarse = (fine + 1).clamp(max=_LEVELS - 1)
        both = self._bilinear(uv, fine) * (1 - share) + self._bilinear(uv, coarse) * share
        return both * both.new_tensor(_STEPS)

    def _bilinear(self, uv: Tensor, level: Int[Tensor, " P"]) -> Float[Tensor, "P 10"]:
        start, size = torch.tensor(self.levels, device=uv.device)[level].unbind(1)
        place = (uv * size[:, None] - 0.5).clamp(min=0).minimum(size[:, None] - 1.0)
        first = place.floor().minimum(size[:, None] - 2.0)
        (fu, fv), (u, v) = (place - first).unbind(1), first.long().unbind(1)
        corner = start + v * size + u
        rows = (corner, corner + 1, corner + size, corner + size + 1)
        weights = ((1 - fu) * (1 - fv), fu * (1 - fv), (1 - fu) * fv, fu * fv)
        parts = [self.table[row].float() * weight[:, None] for row, weight in zip(rows, weights, strict=True)]
        return parts[0] + parts[1] + parts[2] + parts[3]


class SeenSkin(NamedTuple):
    """Where K pixels of a lit image see the mesh.

    Attributes:
        row: [K] of the pixels in the image.
        face: [K].
        barycentric: [K, 3].
        depth: [K] m.
    """

    row: Tensor
    face: Tensor
    barycentric: Tensor
    depth: Tensor


class PixelDetail(NamedTuple):
    """What the detail changes at K pixels of a lit image.

    Attributes:
        row: [K] of the pixels in the image.
        slope: [K, 3] that is subtracted from unit normals, world.
        albedo: [K, 3] factor of colours.
        nail: [K] 1 on nails, 0 on skin.
    """

    row: Tensor
    slope: Tensor
    albedo: Tensor
    nail: Tensor


def detailed_image(image: LitImage, hand: HandInView, maps: DetailMaps, flex: Float[Tensor, " V"]) -> LitImage:
    """The image with the skin's detail.

    Args:
        image: of the hand, at full size.
        hand: posed, in the image's view.
        maps: of the person.
        flex: bend of the skin at the vertices (`SkinBend.flex`).
    """
    return with_detail(image, pixel_detail(image.pixel, image.view, hand, maps, flex))


def pixel_detail(
    pixel: Int[Tensor, " P"], view: Float[Tensor, "P 3"], hand: HandInView, maps: DetailMaps, flex: Float[Tensor, " V"]
) -> PixelDetail:
    """The detail that these pixels show, of which some see the mesh; `view` as in `LitImage`, others as there."""
    seen = seen_skin(hand, pixel)
    gradients = face_gradients(hand.mesh, hand.topology)[seen.face]
    values = _detail_at(seen, maps, hand, gradients, view[seen.row])
    flexed = _blend(flex[hand.topology.faces[seen.face]][..., None], seen.barycentric)
    dorsal, palmar = FOLDS * (1 - FLATTENED * flexed).clamp(min=0), FOLDS * (DEEPENED_FROM + DEEPENED_BY * flexed)
    slopes = values[:, 0:2] - dorsal * values[:, 2:4] - palmar * values[:, 4:6]
    folded = dorsal * values[:, 7:8] + palmar * values[:, 8:9]
    return PixelDetail(
        row=seen.row,
        slope=BUMP * 1e-3 * maps.resolution * hand.mesh.scale * (slopes[:, :, None] * gradients).sum(1),
        albedo=torch.exp(TINT * (values[:, 6:7] + folded * values.new_tensor(FOLD_LOG_ALBEDO))),
        nail=values[:, -1],
    )


def with_detail(image: LitImage, detail: PixelDetail) -> LitImage:
    """The image with this detail, with gradients to its normals and coefficients."""
    row = detail.row
    bent = normalize(image.normal[row] - detail.slope, dim=-1)
    coefficients = image.coefficients.clone()
    coefficients[row, SCATTERED.start : DIFFUSE.stop] *= detail.albedo.repeat(1, 3)
    nail = image.nail.index_put((row,), detail.nail)
    of_nails = nail * image.coefficients[:, GLOSS.start + 1]
    coefficients[:, GLOSS] += torch.stack([of_nails, -of_nails], 1)
    return image._replace(normal=image.normal.index_put((row,), bent), coefficients=coefficients, nail=nail)


def _detail_at(
    seen: SeenSkin, maps: DetailMaps, hand: HandInView, gradients: Float[Tensor, "K 2 3"], view: Float[Tensor, "K 3"]
) -> Float[Tensor, "K 10"]:
    """What the maps hold at the places, without what is finer than a pixel there."""
    uv = places_of_skin(_blend(hand.topology.corner_uv[seen.face], seen.barycentric), gradients, view, hand, maps)
    footprint_m = seen.depth / (hand.camera.focal_px * hand.mesh.scale * _face_cosine(gradients, view))
    return maps.sample(uv, torch.log2(footprint_m / maps.texel_m))


def places_of_skin(
    uv: Float[Tensor, "K 2"],
    gradients: Float[Tensor, "K 2 3"],
    view: Float[Tensor, "K 3"],
    hand: HandInView,
    maps: DetailMaps,
) -> Float[Tensor, "K 2"]:
    """Where in the atlas the skin is that is seen at places of the flat faces (parallax mapping, Kaneko et al. 2001).

    Faces are chords of a round surface, which the skin's relief raises besides: up to a millimetre off.

    Args:
        uv: of the places.
        gradients: of their faces (`face_gradients`).
        view: unit, from the camera.
        hand: posed.
        maps: with the skin's offset.
    """
    per_height = (gradients * view[:, None]).sum(-1) * (hand.mesh.scale / _face_cosine(gradients, view))[:, None]
    offset, there = maps.offset.permute(2, 0, 1)[None], uv
    for _ in range(PLACE_STEPS):
        off = grid_sample(offset, 2 * there[None, None] - 1, padding_mode="border", align_corners=False)[0, :, 0].T
        there = uv - off[:, 2:] * per_height - off[:, :2]
    return there


def _face_cosine(gradients: Float[Tensor, "K 2 3"], view: Float[Tensor, "K 3"]) -> Float[Tensor, " K"]:
    """Of the faces' normals and the view, `LEAST_COSINE` at least."""
    normal = normalize(torch.linalg.cross(gradients[:, 0], gradients[:, 1]), dim=-1)
    return (normal * view).sum(-1).abs().clamp(min=LEAST_COSINE)


def seen_skin(hand: HandInView, pixel: Int[Tensor, " P"]) -> SeenSkin:
    """Which of the pixels see the mesh, and its nearest front faces there."""
    (positions_px, depth), (width, height) = project(hand.camera, hand.mesh.vertices), hand.camera.size_px
    found = rasterise(positions_px, depth, hand.topology.faces, hand.camera.size_px)
    front = found.is_front.nonzero()[:, 0]
    order = front[torch.argsort(found.depth[front], descending=True, stable=True)]
    nearest = torch.full((width * height,), -1, device=pixel.device)
    for_pixel = found.pixel[order]
    last = torch.arange(len(order), device=pixel.device)
    nearest = nearest.scatter_reduce(0, for_pixel, last, "amax")  # the nearest comes last
    row = (nearest[pixel] >= 0).nonzero()[:, 0]
    hit = order[nearest[pixel[row]]]
    face = found.face[hit]
    corners = hand.topology.faces[face]
    centre = torch.stack([pixel[row] % width, pixel[row] // width], -1) + 0.5
    return SeenSkin(row, face, _on_screen(positions_px[corners], depth[corners], centre), found.depth[hit])


def face_gradients(mesh: PosedMesh, topology: Topology) -> Float[Tensor, "F 2 3"]:
    """Gradients of the atlas coordinates u and v on the posed faces, 1/m, world."""
    a, b, c = mesh.vertices[topology.faces].unbind(1)
    ab, ac = b - a, c - a
    normal = torch.linalg.cross(ab, ac)
    squared = (normal * normal).sum(-1, keepdim=True).clamp(min=_TINY**2)
    along_ab, along_ac = torch.linalg.cross(ac, normal) / squared, torch.linalg.cross(normal, ab) / squared
    uv_a, uv_b, uv_c = topology.corner_uv.unbind(1)
    return (uv_b - uv_a)[:, :, None] * along_ab[:, None] + (uv_c - uv_a)[:, :, None] * along_ac[:, None]


def _channels(maps: SkinMaps, look: SkinLook, texels: float) -> list[np.ndarray]:
    """[N, N] each: what the table holds of a person.

    Slopes are in mm a texel of the finest level, whose width is `texels` of these.
    """
    pigment = (1 - look.melanin) * maps.pigment_light + look.melanin * maps.pigment_deep
    relief_mm = maps.relief_mm + look.veins_mm * maps.veins
    heights = relief_mm, maps.dorsal * (DORSAL_MM * look.folds), maps.palmar * (PALMAR_MM * look.folds)
    slopes = [texels * slope for height in heights for slope in reversed(np.gradient(height))]  # along u, along v
    shades = [pigment, maps.dorsal * DORSAL_SHADE, maps.palmar * PALMAR_SHADE]
    return [*slopes, *shades]


def _mask_pyramid(mask: np.ndarray, resolution: int) -> Tensor:
    """[T] int8: level after level of a coarse map from 0 to 1, finer levels by interpolation."""
    coarse = torch.as_tensor(mask, dtype=torch.float32)[None, None]
    fine = interpolate(coarse, size=(resolution, resolution), mode="bilinear")[0]
    return torch.cat([(_halved(fine, level) / _STEPS[-1]).round().to(torch.int8).flatten() for level in range(_LEVELS)])


def _pyramid(fine: np.ndarray, coarse: np.ndarray, step: float) -> Tensor:
    """[T] int8: level after level. One map at a time, for all together take half a gigabyte."""
    fine_map, coarse_map = (torch.as_tensor(np.ascontiguousarray(x), dtype=torch.float32)[None] for x in (fine, coarse))
    levels = [(_level(fine_map, coarse_map, level) / step).round().clamp(-127, 127) for level in range(_LEVELS)]
    return torch.cat([level.to(torch.int8).flatten() for level in levels])


def _level(fine: Float[Tensor, "1 N N"], coarse: Float[Tensor, "1 n n"], level: int) -> Float[Tensor, "1 m m"]:
    """A level of the pyramid: for images whose pixels are its texels, with what their rays pass over."""
    kept = _halved(fine, level)
    resolution, widest = kept.shape[-1], coarse.shape[-1]
    if resolution > widest or RESOLVED_PX * ATLAS_MM / resolution <= COARSEST_MM:
        return kept  # rays resolve more than the planes
    passed_over = coarse - _blurred(coarse, RESOLVED_PX * widest / resolution)
    return kept + _halved(passed_over, (widest // resolution).bit_length() - 1)


def _halved(maps: Float[Tensor, "C N N"], times: int) -> Float[Tensor, "C n n"]:
    """Means over blocks."""
    return avg_pool2d(maps, 1 << times)


def _blurred(maps: Float[Tensor, "C N N"], deviation: float) -> Float[Tensor, "C N N"]:
    """Gaussian blur; 0 lies around the maps."""
    reach = int(_BLUR_REACH * deviation + 0.5)
    weight = torch.exp(-0.5 * (torch.arange(-reach, reach + 1) / deviation) ** 2)
    weight = weight / weight.sum()
    along_u = conv2d(maps[:, None], weight.reshape(1, 1, 1, -1), padding=(0, reach))
    return conv2d(along_u, weight.reshape(1, 1, -1, 1), padding=(reach, 0))[:, 0]


def _on_screen(
    corners: Float[Tensor, "K 3 2"], depth: Float[Tensor, "K 3"], centre: Float[Tensor, "K 2"]
) -> Float[Tensor, "K 3"]:
    """Barycentric coordinates, in space, of the points of triangles that are seen at places on the screen."""
    a, b, c = corners.unbind(1)
    of_corners = torch.stack([_cross(c - b, centre - b), _cross(a - c, centre - c), _cross(b - a, centre - a)], -1)
    weights = of_corners / depth
    return weights / weights.sum(-1, keepdim=True)


def _cross(a: Tensor, b: Tensor) -> Tensor:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _blend(corners: Float[Tensor, "K 3 C"], barycentric: Float[Tensor, "K 3"]) -> Float[Tensor, "K C"]:
    return (corners * barycentric[..., None]).sum(1)
