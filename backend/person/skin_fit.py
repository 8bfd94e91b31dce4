"""Fits pose, shape, offsets and cameras of one hand to its own skin: by flow from what is rendered to the pictures.

Flow is to be trusted only once the rendered skin is the person's own: views of another's contradict each other. Local
contrast is compared, for light and exposure are known less well than folds and spots. Outlines go on counting.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, reduce

import numpy as np
import torch
from scipy.sparse import csr_array

from ..capture.masks.mask import load_opencv
from ..records.hand_picture import BACKGROUND, HAND, HandPicture, PicturedHand
from ..records.shot import HandPose
from ..surface.detail_mesh import SubdivisionLevel
from ..system.parallel_map import parallel_map
from ..system.thread_limits import thread_limit
from .lit_model.flow import bilinear, flow_between, local_contrast, nearest
from .lit_model.illumination import encoded_colours
from .lit_model.model import PersonModel
from .lit_model.picture_lights import PictureIlluminations
from .rig.landmark_pose import LandmarkTargets
from .rig.outline_fit import RigFit, ViewOutlines
from .rig.outlines import OutlinedGeometry, OutlineTree, outline_of_mask, sure_pixels, tells_edges
from .rig.rig_cameras import turned
from .rig.rig_hands import RigHands
from .rig.shape_offsets import OffsetFit, VertexTargets, fitted_offsets

_SMOOTH_PX, _ERROR_PX = 2.0, 1.5  # of flow
_MOST_MM = 6.0  # that skin lies off
_LEAST_FACING, _BEHIND_M = 0.35, 0.003
_INNER_PX, _CLIPPED, _CLIPPED_PX = 9, 0.97, 4.0
_BESIDE_UNKNOWN_PX = 5
_LEAST_WEIGHT = 0.05
_CONTRAST_PX = 10.0


def fitted_to_skin(model: PersonModel, hand: PicturedHand, lights: PictureIlluminations) -> PicturedHand:
    """Return the hand with pose, shape, offsets and cameras moved to where the pictures show the person's skin.

    Args:
        model: with the person's skin and shape so far.
        hand: of calibrated cameras at one moment; those held out are turned to their outlines afterwards.
        lights: of every picture.
    """
    hands, pictures = RigHands.of(model.hand, ("right",)), hand.pictures
    start = RigFit(hands.parameters({"right": pictures[0].pose}), torch.zeros(len(pictures), 4))
    held_out = [row for row, picture in enumerate(pictures) if picture.is_held_out]
    with thread_limit(1):  # operations are small: threads would only wait for each other
        found = fitted_offsets(
            start,
            hands,
            [picture.camera for picture in pictures],
            _outlines(pictures),
            _no_landmarks(),
            held_out,
            _RenderedHand(model, pictures, lights, hands),
            torch.as_tensor(model.offset_m, dtype=torch.float32)[None],
        )
    pose, turns = hands.poses(found.fit.parameters)["right"], found.fit.turns.double().numpy()
    moved = [
        replace(picture, pose=pose, camera=turned(picture.camera, turn))
        for picture, turn in zip(pictures, turns, strict=True)
    ]
    return replace(hand, pictures=tuple(moved), offset_m=found.offset_m[0].double().numpy())


@dataclass(frozen=True)
class _RenderedHand:
    """The skin of the person so far, by flow to the pictures and by its surface."""

    model: PersonModel
    pictures: tuple[HandPicture, ...]
    lights: PictureIlluminations
    hands: RigHands

    def targets(self, state: OffsetFit) -> list[VertexTargets]:
        """Find where pictures that are not held out show the vertices."""
        pose, model = self._at(state)
        turns = state.fit.turns.double().numpy()

        def in_view(row: int) -> VertexTargets:
            picture = self.pictures[row]
            moved = replace(picture, pose=pose, camera=turned(picture.camera, turns[row]))
            return _vertex_targets(model, moved, row, self.lights)

        return parallel_map(in_view, [row for row, each in enumerate(self.pictures) if not each.is_held_out])

    def surface(self, state: OffsetFit) -> OutlinedGeometry:
        """Pose the surface that is rendered, which lies outside the mesh: a finger of it is a fiftieth wider."""
        pose, model = self._at(state)
        template, sums = model.template, self._sums
        is_arm = torch.as_tensor(sums @ self.hands.arm.numpy().astype(float) > 0)
        vertices = model.posed(pose).vertices.double().numpy()
        return OutlinedGeometry(vertices, template.faces, is_arm[template.faces].any(1), sums)

    def _at(self, state: OffsetFit) -> tuple[HandPose, PersonModel]:
        pose = self.hands.poses(state.fit.parameters)["right"]
        return pose, self.model.with_offset(state.offset_m[0].double().numpy())

    @cached_property
    def _sums(self) -> csr_array:
        """[N, V]: of the mesh's vertices, those of the surface without its relief."""
        levels = self.model.template.levels
        return reduce(lambda coarse, level: level @ coarse, [_matrix(level) for level in levels])


def _matrix(level: SubdivisionLevel) -> csr_array:
    return csr_array((level.weight.double().numpy(), (level.row.numpy(), level.column.numpy())))


def _vertex_targets(model: PersonModel, picture: HandPicture, view: int, lights: PictureIlluminations) -> VertexTargets:
    cv2 = load_opencv()
    light = lights.at(picture)
    frame, seen = model.rendered(picture.pose, picture.camera, light.light), model.seen(picture.pose, picture.camera)
    rendered = frame.rgb / np.maximum(frame.alpha[..., None], 1e-3) * light.tint
    both = (picture.labels == HAND) & (frame.alpha > 0.5)
    shown = picture.rgb.astype(np.float32) / 255
    ours, theirs = (local_contrast(image, both, _CONTRAST_PX) for image in (encoded_colours(picture, rendered), shown))
    flow = flow_between(ours, theirs, _SMOOTH_PX, finest_level=0)
    inner = cv2.erode(both.astype(np.uint8), np.ones((_INNER_PX, _INNER_PX))).astype(np.float32)
    clipped = cv2.GaussianBlur((shown.max(-1) > _CLIPPED).astype(np.float32), (0, 0), _CLIPPED_PX)
    px, depth = picture.camera.project(model.vertices(picture.pose))
    scale = _px_per_mm(picture)
    shift = bilinear(flow.px, px)
    is_sure = (depth < nearest(seen.depth, px) + _BEHIND_M) & (nearest(seen.facing, px) > _LEAST_FACING)
    is_sure &= (bilinear(inner, px) > 0.5) & (np.linalg.norm(shift, axis=1) < _MOST_MM * scale)
    weight = is_sure * np.exp(-(bilinear(flow.error_px, px) ** 2) / (2 * _ERROR_PX**2)) * (1 - bilinear(clipped, px))
    vertex = np.flatnonzero(weight > _LEAST_WEIGHT)
    goal, sureness = (torch.as_tensor(each[vertex], dtype=torch.float32) for each in (px + shift, weight))
    return VertexTargets(0, view, torch.as_tensor(vertex), goal, sureness, scale)


def _px_per_mm(picture: HandPicture) -> float:
    """Compute the px of a millimetre at the hand."""
    depth_m = (picture.pose.transl - picture.camera.origin) @ picture.camera.cam2world[:3, 2]
    return float(picture.camera.K[0, 0] / abs(depth_m) / 1000)


def _outlines(pictures: tuple[HandPicture, ...]) -> ViewOutlines:
    """Find the hand's outlines against what is known to be no hand, and not so bright that it hides them."""
    trees, px_per_mm = {}, {}
    for row, picture in enumerate(pictures):
        is_known = sure_pixels(picture.labels, _BESIDE_UNKNOWN_PX)
        is_known &= tells_edges(picture.rgb, picture.labels == BACKGROUND)
        px_per_mm[row] = _px_per_mm(picture)
        trees[row] = OutlineTree(outline_of_mask(picture.labels, is_known), px_per_mm[row], is_known)
    return ViewOutlines(trees, px_per_mm)


def _no_landmarks() -> LandmarkTargets:
    none = torch.zeros(0, dtype=torch.long)
    return LandmarkTargets(none, none, torch.zeros(0, 21, 2), torch.zeros(0))
