"""Poses of all pictures and one shape, fitted again: by flow between what the model renders and pictures, and outlines.

Landmarks put a hand within a centimetre. Once the model has about the person's skin and light, flow says for every
visible vertex where it should be. A vertex at the hand's outline should lie on the mask's, somewhere: only its distance
across that edge counts. Pictures of one moment share their pose, all share the shape; held-out ones fit their pose
alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from scipy.spatial import KDTree
from torch import Tensor

from ..capture.masks.mask import load_opencv
from ..hand.joint_axes import anatomical_axes
from ..hand.joint_limits import FREE
from ..hand.lbs import SkinTensors, pose_hand, posed_vertices
from ..hand.model import HandModel
from ..records.camera import Camera
from ..records.hand_picture import HAND, UNKNOWN, HandPicture
from ..records.shot import HandPose
from ..system.parallel_map import parallel_map
from ..system.thread_limits import thread_limit
from .flow import bilinear, flow_between, nearest
from .hand_size import LengthPrior
from .illumination import Illumination, encoded_colours
from .model import GeometryMaps, PersonModel
from .rig.outlines import outline_of, outline_of_mask, sure_pixels

_ALONG_PX = 2.0  # of the outline: vertices so near to it belong to it
_FARTHEST_PX = 30.0
_LEAST_AGREEMENT = 0.5  # cosine of both edges' directions
_BESIDE_UNKNOWN_PX = 9


class OutlineTargets(NamedTuple):
    """K vertices at the outline: which, the points [K, 2] px of the mask's edge, and its unit normals [K, 2] there."""

    vertex: np.ndarray
    px: np.ndarray
    normal: np.ndarray


def outline_targets(seen: GeometryMaps, labels: np.ndarray, vertices_px: np.ndarray) -> OutlineTargets:
    """Match the outline of the surface to that of a mask.

    Args:
        seen: of the surface in the picture.
        labels: [H, W] of the picture.
        vertices_px: [V, 2] the mesh's, projected.
    """
    ours, theirs = outline_of(seen.is_seen), outline_of_mask(labels, sure_pixels(labels, _BESIDE_UNKNOWN_PX))
    nothing = OutlineTargets(np.zeros(0, int), np.zeros((0, 2)), np.zeros((0, 2)))
    if not len(ours.px) or not len(theirs.px):
        return nothing
    distance, at = (np.asarray(found) for found in KDTree(ours.rim_px).query(vertices_px))
    vertex = np.flatnonzero(distance < _ALONG_PX)
    off, matched = (np.asarray(found) for found in KDTree(theirs.rim_px).query(vertices_px[vertex]))
    agrees = (ours.normal[at[vertex]] * theirs.normal[matched]).sum(1) > _LEAST_AGREEMENT
    kept = agrees & (off < _FARTHEST_PX)
    return OutlineTargets(vertex[kept], theirs.rim_px[matched[kept]], theirs.normal[matched[kept]])


_MASK_SHARE = 0.2  # of grey that tells hand from backdrop in the flow
_FLOW_ERROR_PX, _BEHIND_M, _LEAST_FACING = 3.0, 0.004, 0.15
_LARGE_PX = 4.0  # residuals beyond it count linearly
_STEPS = 120
_RATES = (0.01, 0.02, 0.0015, 0.005)  # of theta, beta, transl, forearm
_THETA_WEIGHT, _BETA_WEIGHT, _TRANSL_M, _FOREARM_RAD = 6.0, 0.15, 0.04, 0.4
_OUTLINE_WEIGHT = 0.5
_HINGE_WEIGHT = 30.0  # of turns that fingers hardly have, rad^2


class PoseTargets(NamedTuple):
    """Where a picture wants the mesh's vertices.

    Attributes:
        px: [V, 2].
        weight: [V] 0 of those that it does not show.
        outline: of vertices at the outline.
        flow_px: mean length of the flow.
        overlap: intersection over union of hand and mask, of what is known.
    """

    px: np.ndarray
    weight: np.ndarray
    outline: OutlineTargets
    flow_px: float
    overlap: float

    def enlarged(self, larger_by: np.ndarray) -> PoseTargets:
        """Return the targets in a picture larger by these factors [2] along x and y."""
        outline = self.outline._replace(px=self.outline.px * larger_by)
        flow_px = self.flow_px * float(np.mean(larger_by))
        return self._replace(px=self.px * larger_by, outline=outline, flow_px=flow_px)


@dataclass(frozen=True)
class Refit:
    """Pictures with their new poses, and means over them before the fit: flow in px, and overlap."""

    pictures: tuple[HandPicture, ...]
    flow_px: float
    overlap: float


def refitted(
    model: PersonModel,
    pictures: Sequence[HandPicture],
    lights: Mapping[int, Illumination],
    fits_shape: bool = True,
    on_picture: Callable[[], None] = lambda: None,
    length_m: float | None = None,
    longest_px: int | None = None,
) -> Refit:
    """Fit the poses of all pictures and one shape once, from where they are.

    Args:
        model: with the person's skin so far.
        pictures: with their poses, whose shape is one.
        lights: by scene.
        fits_shape: move the shape, too.
        on_picture: called after each one's flow.
        length_m: of the hand (`hand_size.sized`); None: not known.
        longest_px: side of the pictures in which flow is looked for; None: their own.
    """

    def targets_in(picture: HandPicture) -> PoseTargets:
        small = picture if longest_px is None else made_smaller(picture, longest_px)
        larger_by = np.divide(picture.camera.size_px, small.camera.size_px)
        return pose_targets(model, small, lights[picture.scene]).enlarged(larger_by)

    targets = parallel_map(targets_in, pictures, on_picture)
    with thread_limit(1):  # operations are small: threads would only wait for each other
        poses = _fitted(model, pictures, targets, fits_shape, length_m)
    moved = tuple(replace(picture, pose=pose) for picture, pose in zip(pictures, poses, strict=True))
    flow_px, overlap = (float(np.mean([getattr(each, name) for each in targets])) for name in ("flow_px", "overlap"))
    return Refit(moved, flow_px, overlap)


def made_smaller(picture: HandPicture, longest_px: int) -> HandPicture:
    """Return a picture whose sides are no longer than this."""
    factor = longest_px / max(picture.camera.size_px)
    if factor >= 1:
        return picture
    cv2, camera = load_opencv(), picture.camera.scaled(factor)
    rgb = cv2.resize(picture.rgb, camera.size_px, interpolation=cv2.INTER_AREA)
    labels = cv2.resize(picture.labels, camera.size_px, interpolation=cv2.INTER_NEAREST)
    return replace(picture, rgb=rgb, labels=labels, camera=camera)


def pose_targets(model: PersonModel, picture: HandPicture, light: Illumination) -> PoseTargets:
    """Find where a picture wants the vertices of its hand."""
    frame = model.rendered(picture.pose, picture.camera, light.light)
    seen = model.seen(picture.pose, picture.camera)
    vertices = model.vertices(picture.pose)
    px, depth = picture.camera.project(vertices)
    rendered = frame.rgb / np.maximum(frame.alpha[..., None], 1e-3) * light.tint
    is_known, is_hand = (picture.labels != UNKNOWN), picture.labels == HAND
    ours = _grey(encoded_colours(picture, rendered), (seen.is_seen & is_known).astype(np.float32))
    theirs = _grey(picture.rgb.astype(np.float32) / 255, is_hand.astype(np.float32))
    flow = flow_between(ours, theirs, 1.5)
    visible = _visible_vertices(seen, px, depth)
    weight = visible * np.exp(-(bilinear(flow.error_px, px) ** 2) / (2 * _FLOW_ERROR_PX**2))
    weight = weight * (nearest(picture.labels, px) != UNKNOWN)
    shift = bilinear(flow.px, px)
    length = float((np.linalg.norm(shift, axis=1) * visible).sum() / max(visible.sum(), 1))
    union = ((seen.is_seen & is_known) | is_hand).sum()
    overlap = float((seen.is_seen & is_hand).sum() / max(union, 1))
    return PoseTargets(px + shift, weight, outline_targets(seen, picture.labels, px), length, overlap)


def _grey(encoded: np.ndarray, mask: np.ndarray) -> np.ndarray:
    return mask * ((1 - _MASK_SHARE) * encoded.mean(-1) + _MASK_SHARE)


def _visible_vertices(seen: GeometryMaps, px: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Find (1) the vertices [V] that the picture shows, which lie on the surface or just below it."""
    shown = nearest(np.where(seen.is_seen, seen.depth, np.inf), px)
    height, width = seen.is_seen.shape
    inside = ((px >= 1) & (px < (width - 1, height - 1))).all(1)
    facing = nearest(np.where(seen.is_seen, seen.facing, 0), px)
    return (inside & np.isfinite(shown) & (depth < shown + _BEHIND_M) & (facing > _LEAST_FACING)).astype(np.float64)


class _Cameras(NamedTuple):
    """Of K pictures: [K, 3, 3] intrinsics, and [K, 3, 4] from the world."""

    K: Tensor
    world2cam: Tensor

    @classmethod
    def of(cls, cameras: Sequence[Camera]) -> _Cameras:
        K = np.stack([camera.K for camera in cameras])
        world2cam = np.stack([np.linalg.inv(camera.cam2world)[:3] for camera in cameras])
        return cls(torch.as_tensor(K, dtype=torch.float32), torch.as_tensor(world2cam, dtype=torch.float32))

    def project(self, points: Tensor) -> Tensor:
        """Project points [K, V, 3] to [K, V, 2] px."""
        within = points @ self.world2cam[:, :, :3].transpose(1, 2) + self.world2cam[:, None, :, 3]
        homogeneous = within @ self.K.transpose(1, 2)
        return homogeneous[..., :2] / homogeneous[..., 2:]


def _fitted(
    model: PersonModel,
    pictures: Sequence[HandPicture],
    targets: Sequence[PoseTargets],
    fits_shape: bool,
    length_m: float | None,
) -> list[HandPose]:
    skin, cameras = SkinTensors.of(model.hand.for_side("right")), _Cameras.of([one.camera for one in pictures])
    first, pose_of = _poses_of(pictures)
    start = [
        torch.as_tensor(np.stack([getattr(pictures[index].pose, name) for index in first]), dtype=torch.float32)
        for name in ("theta", "transl", "forearm")
    ]
    first_beta = torch.as_tensor(pictures[0].pose.beta, dtype=torch.float32)
    length = None if length_m is None else LengthPrior.of(model.hand, pictures[0].pose.beta, length_m)
    theta, transl, forearm = (values.clone().requires_grad_(True) for values in start)
    beta = first_beta.clone().requires_grad_(fits_shape)
    shapes_beta = torch.tensor([not one.is_held_out for one in pictures])[:, None]
    goal = torch.as_tensor(np.stack([each.px for each in targets]), dtype=torch.float32)
    weight = torch.as_tensor(np.stack([each.weight for each in targets]), dtype=torch.float32)
    outlines = _Outlines.of([each.outline for each in targets])
    hinges = HingeTurns.of(model.hand)
    offset_m = torch.as_tensor(np.stack([_offset(model, one.pose) for one in pictures]), dtype=torch.float32)
    parameters = [(theta, _RATES[0]), (transl, _RATES[2]), (forearm, _RATES[3])]
    parameters += [(beta, _RATES[1])] if fits_shape else []
    optimiser = torch.optim.Adam([{"params": [each], "lr": rate} for each, rate in parameters], betas=(0.9, 0.99))
    for step in range(_STEPS):
        for group, (_, rate) in zip(optimiser.param_groups, parameters, strict=True):
            group["lr"] = rate * (1 - step / _STEPS)
        shape = torch.where(shapes_beta, beta, beta.detach())
        vertices = pose_hand(skin, theta[pose_of], shape, transl[pose_of], forearm[pose_of]).vertices
        px = cameras.project(vertices + offset_m)
        data = (weight * _robust((px - goal).norm(dim=-1))).sum(1) / weight.sum(1).clamp(min=1)
        loss = data.mean() + _OUTLINE_WEIGHT * outlines.loss(px)
        loss = loss + _THETA_WEIGHT * ((theta - start[0])[:, 1:] ** 2).sum((1, 2)).mean()
        loss = loss + _HINGE_WEIGHT * (hinges(theta) ** 2).sum(1).mean()
        loss = loss + _BETA_WEIGHT * ((beta - first_beta) ** 2).sum()
        loss = loss if length is None else loss + length.loss(beta)
        loss = loss + 0.5 * (((transl - start[1]) / _TRANSL_M) ** 2).sum(1).mean()
        loss = loss + 0.5 * (((forearm - start[2]) / _FOREARM_RAD) ** 2).sum(1).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    fitted = (values.detach().double().numpy() for values in (theta, transl, forearm))
    shape = beta.detach().double().numpy()
    poses = [HandPose(a, shape, b, "right", c) for a, b, c in zip(*fitted, strict=True)]
    return [poses[row] for row in pose_of.tolist()]


class HingeTurns(NamedTuple):
    """The axes [15, 3, 3] of the fingers' joints, and which [45] of the turns about them hinges do not allow."""

    axes: Tensor
    is_stiff: Tensor

    @classmethod
    def of(cls, hand: HandModel) -> HingeTurns:
        """Take a hand's axes; all but the free angles of `joint_limits` are stiff."""
        is_stiff = torch.ones(45, dtype=torch.bool)
        is_stiff[torch.as_tensor(FREE)] = False
        return cls(torch.as_tensor(anatomical_axes(hand), dtype=torch.float32), is_stiff)

    def __call__(self, theta: Tensor) -> Tensor:
        """Return those turns [K, S], rad, of poses [K, 16, 3], to first order."""
        turns = torch.einsum("jac,kjc->kja", self.axes, theta[:, 1:])
        return turns.flatten(1)[:, self.is_stiff]


def _poses_of(pictures: Sequence[HandPicture]) -> tuple[list[int], Tensor]:
    """Return the first picture of each of P poses, and the pose [K] that each picture shows."""
    first: dict[object, int] = {}
    for index, picture in enumerate(pictures):
        first.setdefault(("alone", index) if picture.moment is None else picture.moment, index)
    row = {index: place for place, index in enumerate(first.values())}
    shown = [row[index if picture.moment is None else first[picture.moment]] for index, picture in enumerate(pictures)]
    return list(first.values()), torch.as_tensor(shown)


def _offset(model: PersonModel, pose: HandPose) -> np.ndarray:
    """Return what the person's own shape adds to the posed vertices [V, 3], m, world; small turns do not change it."""
    return model.vertices(pose) - posed_vertices(model.hand, pose)


def _robust(residual_px: Tensor) -> Tensor:
    """Square small residuals; grow linearly beyond `_LARGE_PX`."""
    return _LARGE_PX**2 * (torch.sqrt(1 + (residual_px / _LARGE_PX) ** 2) - 1)


class _Outlines(NamedTuple):
    """Targets of all pictures' outlines in one list: picture, vertex, point, normal."""

    picture: Tensor
    vertex: Tensor
    px: Tensor
    normal: Tensor

    @classmethod
    def of(cls, outlines: Sequence[OutlineTargets]) -> _Outlines:
        picture = np.concatenate([np.full(len(each.vertex), index) for index, each in enumerate(outlines)]).astype(
            np.int64
        )
        vertex, px, normal = (np.concatenate(values) for values in zip(*outlines, strict=True))
        return cls(
            torch.as_tensor(picture),
            torch.as_tensor(vertex.astype(np.int64)),
            torch.as_tensor(px, dtype=torch.float32),
            torch.as_tensor(normal, dtype=torch.float32),
        )

    def loss(self, px: Tensor) -> Tensor:
        """Return the mean robust distance across edges."""
        if not len(self.picture):
            return px.new_zeros(())
        off = ((px[self.picture, self.vertex] - self.px) * self.normal).sum(-1).abs()
        return _robust(off).mean()
