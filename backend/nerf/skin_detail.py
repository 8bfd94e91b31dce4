"""The fine detail of a known skin on a lit image: bump mapping at full size (Blinn 1978).

The rays of a relightable field tell colour and normal at half the image's size and to the resolution of its planes.
Folds, lines and the rims of nails are finer; where they are known (`hand.skin_detail`) they bend the normals of the
full-size image, in which lamps and gloss are evaluated, and darken its coefficients.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import avg_pool2d, normalize

from ..geometry.mesh import PosedMesh, Topology
from ..geometry.rasterise import rasterise
from ..hand.skin_detail import ATLAS_MM, SkinDetail
from .lighting import DIFFUSE, SCATTERED
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
TINT = 0.5
"""Share of the pigment and of the colour of folds: the rest is in an avatar's own planes."""
LEAST_COSINE = 0.25
"""Of normal and view: flatter views are filtered as this one."""
SLOPE_STEP_MM, SHADE_STEP = 0.001, 0.01
"""What one step of the stored whole numbers is worth: slopes in mm a texel."""
CHANNELS = 9
"""Slopes along u and v of relief, dorsal folds and palmar creases; pigment; dorsal folds; palmar creases."""
_LEVELS = 6
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
        table: [T, 9] int8: the texels of all levels, rows of the finest first, the smallest v first.
        resolution: of the finest level.
        texel_m: its texels' side, template metres.
    """

    table: Tensor
    resolution: int
    texel_m: float

    @classmethod
    def of(cls, detail: SkinDetail, look: SkinLook, device: torch.device | str = "cpu") -> DetailMaps:
        """The maps of a person.

        Args:
            detail: of the hand.
            look: of the person.
            device: of the table.
        """
        pigment = (1 - look.melanin) * detail.pigment_light + look.melanin * detail.pigment_deep
        relief_mm = detail.relief_mm + look.veins_mm * detail.veins
        heights = relief_mm, detail.dorsal * (DORSAL_MM * look.folds), detail.palmar * (PALMAR_MM * look.folds)
        values = [slope for height in heights for slope in _slopes(height)]
        shades = [pigment, detail.dorsal * DORSAL_SHADE, detail.palmar * PALMAR_SHADE]
        steps = [SLOPE_STEP_MM] * len(values) + [SHADE_STEP] * len(shades)
        columns = [_pyramid(value, step) for value, step in zip([*values, *shades], steps, strict=True)]
        resolution = len(detail.relief_mm)
        return cls(torch.stack(columns, 1).to(device), resolution, ATLAS_MM / 1000 / resolution)

    @property
    def levels(self) -> list[tuple[int, int]]:
        """(first row of the table, resolution) of each level."""
        sizes = [self.resolution >> level for level in range(_LEVELS)]
        return [(sum(size**2 for size in sizes[:level]), sizes[level]) for level in range(_LEVELS)]

    def sample(self, uv: Float[Tensor, "P 2"], level: Float[Tensor, " P"]) -> Float[Tensor, "P 9"]:
        """Trilinear, in mm a texel and logarithms."""
        fine = level.clamp(0, _LEVELS - 1).floor().long()
        share = (level.clamp(0, _LEVELS - 1) - fine)[:, None]
        coarse = (fine + 1).clamp(max=_LEVELS - 1)
        both = self._bilinear(uv, fine) * (1 - share) + self._bilinear(uv, coarse) * share
        return both * both.new_tensor([SLOPE_STEP_MM] * 6 + [SHADE_STEP] * 3)

    def _bilinear(self, uv: Tensor, level: Int[Tensor, " P"]) -> Float[Tensor, "P 9"]:
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


def detailed_image(image: LitImage, hand: HandInView, maps: DetailMaps, flex: Float[Tensor, " V"]) -> LitImage:
    """The image with the skin's detail.

    Args:
        image: of the hand, at full size.
        hand: posed, in the image's view.
        maps: of the person.
        flex: bend of the skin at the vertices (`SkinBend.flex`).
    """
    seen = seen_skin(hand, image.pixel)
    normal = image.normal[seen.row]
    values = _detail_at(seen, maps, hand, (normal * image.view[seen.row]).sum(-1).abs())
    flexed = _blend(flex[hand.topology.faces[seen.face]][..., None], seen.barycentric)
    dorsal, palmar = (1 - FLATTENED * flexed).clamp(min=0), DEEPENED_FROM + DEEPENED_BY * flexed
    slopes = values[:, 0:2] - dorsal * values[:, 2:4] - palmar * values[:, 4:6]
    along = (slopes[:, :, None] * face_gradients(hand.mesh, hand.topology)[seen.face]).sum(1)
    bent = normalize(normal - BUMP * 1e-3 * maps.resolution * hand.mesh.scale * along, dim=-1)
    folded = dorsal * values[:, 7:8] + palmar * values[:, 8:9]
    albedo = torch.exp(TINT * (values[:, 6:7] + folded * values.new_tensor(FOLD_LOG_ALBEDO)))
    coefficients = image.coefficients.clone()
    coefficients[seen.row, SCATTERED.start : DIFFUSE.stop] *= albedo.repeat(1, 3)
    return image._replace(normal=image.normal.index_put((seen.row,), bent), coefficients=coefficients)


def _detail_at(seen: SeenSkin, maps: DetailMaps, hand: HandInView, cosine: Float[Tensor, " K"]) -> Float[Tensor, "K 9"]:
    """What the maps hold at the places, without what is finer than a pixel there."""
    uv = _blend(hand.topology.corner_uv[seen.face], seen.barycentric)
    footprint_m = seen.depth / (hand.camera.focal_px * hand.mesh.scale * cosine.clamp(min=LEAST_COSINE))
    return maps.sample(uv, torch.log2(footprint_m / maps.texel_m))


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


def _slopes(height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Central differences along u (columns) and v (rows), mm a texel."""
    along_v, along_u = np.gradient(height)
    return along_u, along_v


def _pyramid(values: np.ndarray, step: float) -> Tensor:
    """[T] int8: means over blocks, level after level."""
    level = torch.as_tensor(np.ascontiguousarray(values), dtype=torch.float32)[None]
    flat = []
    for _ in range(_LEVELS):
        flat.append((level / step).round().clamp(-127, 127).to(torch.int8).flatten())
        level = avg_pool2d(level, 2)
    return torch.cat(flat)


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
