"""What pictures say about the albedo of each texel: its logarithm over that of the base, averaged over pictures.

Each texel's place on the posed surface is looked up in every picture that sees it, near where it is projected: at a
place that dense flow between the picture and what the model renders corrects. Pictures that are sharper there, nearer
and seen more from the front count more; those that contradict the others count less. What a camera clipped was at least
as bright, in the channels that it clipped.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ...capture.masks.mask import load_opencv
from ...geometry.tolerances import NEAR_M
from ...records.hand_picture import HAND, UNKNOWN, HandPicture
from ...surface.atlas_texels import AtlasTexels
from ...surface.detail_mesh import DetailMesh
from ...system.parallel_map import parallel_map
from ..lit_model.flow import bilinear, flow_between, nearest
from ..lit_model.illumination import Illumination, encoded_colours, linear_colours
from ..lit_model.model import GeometryMaps, PersonModel
from ..lit_model.picture_lights import PictureIlluminations
from .agreement import GatheredRatio, TexelSighting, agreed_ratio, levelled

_LEAST_FACING = 0.25
_BEHIND_M = 0.004  # farther than the surface that is seen: hidden
_STEP_M = 0.012  # of depth within a few pixels: a border of two parts
_CLIPPED, _DARKEST = 0.98, 0.03
_NOISE = 0.004  # linear; below it logarithms say nothing
_FLOW_ERROR_PX = 2.0
_BACKDROP = 0.1
_FOOTPRINT_POWER = 4
_ERODED_PX, _FAR_ERODED_PX = 3, 5


def gathered_ratio(
    model: PersonModel,
    texels: AtlasTexels,
    pictures: Sequence[HandPicture],
    lights: PictureIlluminations,
    ratio: np.ndarray | None,
    with_flow: bool = True,
    levels: bool = False,
    on_picture: Callable[[], None] = lambda: None,
) -> GatheredRatio:
    """Gather what pictures show.

    Args:
        model: with the ratio so far.
        texels: of the atlas.
        pictures: of the hand.
        lights: of every picture.
        ratio: [T, 3] logarithms that the model has; None: zeros.
        with_flow: correct places by flow; harmful while the model's texture is not the person's and views differ much.
        levels: take what is coarse from all pictures together (`levelled`): of the last texture, for poses are found
            better with each picture's own light in it.
        on_picture: called after each.
    """
    usual_px_per_mm = float(np.median([_px_per_mm(picture) for picture in pictures]))

    def sighting_in(picture: HandPicture) -> TexelSighting:
        sighting = _sighting(model, texels, picture, lights.at(picture), with_flow, usual_px_per_mm)
        known = 0 if ratio is None else ratio
        log_ratio, coarse = ((each + known).astype(np.float16) for each in (sighting.log_ratio, sighting.coarse))
        return sighting._replace(log_ratio=log_ratio, coarse=coarse)

    sightings = parallel_map(sighting_in, pictures, on_picture)
    sightings = levelled(sightings) if levels else sightings
    return agreed_ratio(sightings, np.zeros((len(texels.pixel), 3), np.float32) if ratio is None else ratio)


def _sighting(
    model: PersonModel,
    texels: AtlasTexels,
    picture: HandPicture,
    light: Illumination,
    with_flow: bool,
    usual_px_per_mm: float,
) -> TexelSighting:
    frame = model.rendered(picture.pose, picture.camera, light.light)
    seen = model.seen(picture.pose, picture.camera)
    encoded = picture.rgb.astype(np.float32) / 255
    shown = linear_colours(picture)
    rendered = frame.rgb / np.maximum(frame.alpha[..., None], 1e-3)
    place = _ProjectedTexels.of(texels, seen, picture, usual_px_per_mm)
    flow_px = np.zeros((*shown.shape[:2], 2), np.float32)
    error_px = np.zeros(shown.shape[:2], np.float32)
    if with_flow:
        tinted = rendered * light.tint.astype(np.float32)
        flow_px, error_px = _flow(encoded_colours(picture, tinted), frame.alpha, encoded, picture.labels)
    visible = np.flatnonzero(place.weight)
    px = place.px[visible]
    moved = px + bilinear(flow_px, px)
    usable, is_clipped = _usable(encoded, picture.labels)
    weight, log_ratio = np.zeros_like(place.weight), np.zeros((len(place.weight), 3), np.float32)
    is_bound = np.zeros(log_ratio.shape, bool)
    weight[visible] = place.weight[visible] * (bilinear(usable, moved) > 0.95)
    weight[visible] *= np.exp(-(bilinear(error_px, px) ** 2) / (2 * _FLOW_ERROR_PX**2))
    weight *= _sharpness(encoded, seen.is_seen)
    log_ratio[visible] = np.log((bilinear(shown, moved) + _NOISE) / (bilinear(rendered, px) + _NOISE))
    mask = _depth_edges(seen)[1] * _moved(usable * (is_clipped.max(-1) < 1), flow_px)
    coarse = np.full_like(log_ratio, np.nan)
    coarse[visible] = bilinear(_coarse(_moved(shown, flow_px), rendered, mask, _COARSE_MM * usual_px_per_mm), px)
    length = float(np.linalg.norm(flow_px[seen.is_seen], axis=1).mean()) if seen.is_seen.any() else 0.0
    is_bound[visible] = bilinear(is_clipped, moved) > 0.05
    return TexelSighting(weight, log_ratio, coarse, is_bound, length)


class _ProjectedTexels(NamedTuple):
    """Where the texels are in a picture: [T, 2] px, and how well it shows them, 0 where it does not."""

    px: np.ndarray
    weight: np.ndarray

    @classmethod
    def of(
        cls, texels: AtlasTexels, seen: GeometryMaps, picture: HandPicture, usual_px_per_mm: float
    ) -> _ProjectedTexels:
        camera, mesh = picture.camera, seen.mesh
        near = np.flatnonzero(_turned_to(camera.origin, mesh)[texels.face])
        position, normal = (texels.at_texels(each.numpy(), near) for each in (mesh.vertices, mesh.normals))
        away = position - camera.origin.astype(np.float32)
        near_px, depth = camera.project(position)
        facing = -(normal * away).sum(1) / (np.linalg.norm(normal, axis=1) * np.linalg.norm(away, axis=1))
        nearer, is_inner = _depth_edges(seen)
        is_visible = (depth > NEAR_M) & (facing > _LEAST_FACING) & (depth < nearest(nearer, near_px) + _BEHIND_M)
        is_visible &= bilinear(is_inner, near_px) > 0.95
        px_per_mm = camera.K[0, 0] / np.maximum(depth, NEAR_M) / 1000
        weight = is_visible * facing.clip(0) * np.minimum(px_per_mm / usual_px_per_mm, _MOST_FINER)
        px, weights = np.zeros((len(texels.pixel), 2), np.float32), np.zeros(len(texels.pixel), np.float32)
        px[near], weights[near] = near_px, weight.astype(np.float32) ** _FOOTPRINT_POWER
        return cls(px, weights)


def _turned_to(origin: np.ndarray, mesh: DetailMesh) -> np.ndarray:
    """Find the faces [M] of which a corner may be seen from a point."""
    away, normal = mesh.vertices.numpy() - origin.astype(np.float32), mesh.normals.numpy()
    is_turned = -(normal * away).sum(1) > 0.5 * _LEAST_FACING * np.linalg.norm(away, axis=1)
    return is_turned[mesh.faces.numpy()].any(1)


def _px_per_mm(picture: HandPicture) -> float:
    """Return the size of the hand in a picture."""
    pose, camera = picture.pose, picture.camera
    depth = (np.asarray(pose.transl) - camera.origin) @ camera.cam2world[:3, 2]
    return float(camera.K[0, 0] / max(abs(depth), NEAR_M) / 1000)


_MOST_FINER = 1.5
"""By which a picture that shows the hand larger than usual counts more."""


def _depth_edges(seen: GeometryMaps) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest depth around each pixel, and where (1) no part of the hand ends before another."""
    cv2 = load_opencv()
    depth = np.where(seen.is_seen, seen.depth, 9.0).astype(np.float32)
    around = np.ones((5, 5))
    near = cv2.erode(depth, np.ones((3, 3)))
    is_even = np.abs(cv2.dilate(depth, around) - cv2.erode(depth, around)) < _STEP_M
    inner = cv2.erode((seen.is_seen & (seen.facing > 0.2)).astype(np.uint8), np.ones((_ERODED_PX, _ERODED_PX)))
    return near, (inner * is_even).astype(np.float32)


def _usable(encoded: np.ndarray, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where (1) a picture surely shows the hand and not its dark, and where (1) [H, W, 3] it is clipped."""
    cv2 = load_opencv()
    is_hand = cv2.erode((labels == HAND).astype(np.uint8), np.ones((_FAR_ERODED_PX, _FAR_ERODED_PX)))
    usable = is_hand * (encoded.max(-1) > _DARKEST)
    return usable.astype(np.float32), (encoded >= _CLIPPED).astype(np.float32)


def _flow(
    rendered: np.ndarray, alpha: np.ndarray, encoded: np.ndarray, labels: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Find the flow from what the model renders to the picture, both on a backdrop."""
    is_known = (labels != UNKNOWN).astype(np.float32)
    ours, theirs = alpha * is_known, (labels == HAND).astype(np.float32)
    grey = [picture.mean(-1) * mask + _BACKDROP * (1 - mask) for picture, mask in ((rendered, ours), (encoded, theirs))]
    return flow_between(*grey)


def _sharpness(encoded: np.ndarray, where: np.ndarray) -> float:
    """Measure how sharp a picture is where it shows the hand, from the share of its contrast that is fine."""
    cv2 = load_opencv()
    grey = encoded.mean(-1)
    if not where.any():
        return 0.1
    fine, all_of_it = (np.abs(grey - cv2.GaussianBlur(grey, (0, 0), px))[where].mean() for px in (1.0, 4.0))
    return float(np.clip(fine / max(all_of_it, 1e-6) / _USUAL_SHARPNESS, 0.1, 2.0))


_USUAL_SHARPNESS = 0.3


_COARSE_MM = 3.0  # deviation of the blur that leaves what is coarse
_LEAST_SHARE = 0.1  # of the pixels within it, that tell of what is coarse


def _coarse(shown: np.ndarray, rendered: np.ndarray, mask: np.ndarray, sigma_px: float) -> np.ndarray:
    """Blur the logarithm [H, W, 3] of what is shown over what is rendered, in a mask; NaN where it leaves little."""
    cv2 = load_opencv()
    off = np.log((shown + _NOISE) / (rendered + _NOISE)).astype(np.float32) * mask[..., None]
    share = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), sigma_px)[..., None]
    return np.where(share > _LEAST_SHARE, cv2.GaussianBlur(off, (0, 0), sigma_px) / share.clip(_LEAST_SHARE), np.nan)


def _moved(image: np.ndarray, flow_px: np.ndarray) -> np.ndarray:
    """Look an image [H, W, ...] up where flow leads."""
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]].astype(np.float32)
    cv2 = load_opencv()
    return cv2.remap(
        image.astype(np.float32), columns + flow_px[..., 0], rows + flow_px[..., 1], interpolation=cv2.INTER_LINEAR
    )
