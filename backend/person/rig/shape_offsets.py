"""The shape that a hand model's ten numbers cannot say: offsets of the skin along its normals, by outlines.

Neighbouring vertices move together (a Laplacian prior), offsets are small, and the forearm has none. Poses, the one
shape and the cameras' turns follow too, held near to where they were. Beside outlines, visible vertices may be given
targets in the pictures, such as the flow from the person's own rendered skin to the photograph.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ...records.camera import Camera
from .landmark_pose import LandmarkTargets
from .outline_fit import RigFit, ViewOutlines, paired, picture_loss, with_turned_cameras
from .outlines import OutlinedGeometry
from .rig_cameras import RigCameras
from .rig_hands import HandParameters, RigHands

ROUNDS = 3
_STEPS = 120
_REACH_MM = 7.0
_ACROSS_MM = 1.5
_RATES = (0.004, 0.02, 0.0005, 0.005, 0.0003, 0.0002)  # of theta, beta, transl, forearm, offsets and turns
_LAST_RATE = 0.1
_THETA_WEIGHT, _BETA_WEIGHT, _FOREARM_WEIGHT = 0.3, 0.02, 3.0
_SMALL_WEIGHT, _ARM_WEIGHT = 0.05, 5.0  # of square millimetres, means over the vertices
_SMOOTH_WEIGHT, _SMOOTH_WEIGHT_OF_TARGETS = 4.0, 1.0  # too; outlines alone tell nothing of what lies between them
_TURN_RAD, _TURN_WEIGHT = 0.0015, 0.3
_TARGET_MM, _TARGET_WEIGHT, _FEW = 1.5, 4.0, 40.0  # of given targets; a view with fewer weighs less


class VertexTargets(NamedTuple):
    """Where visible vertices of a hand lie in one picture.

    Attributes:
        hand: row of the hand.
        view: row of the view.
        vertex: [N] of the hand.
        px: [N, 2].
        weight: [N], 1 for a sure one.
        px_per_mm: px in a millimetre at the hand.
    """

    hand: int
    view: int
    vertex: Tensor
    px: Tensor
    weight: Tensor
    px_per_mm: float


class OffsetFit(NamedTuple):
    """A fit, and the offsets [S, V] m of each hand along its posed normals."""

    fit: RigFit
    offset_m: Tensor


@runtime_checkable
class HandAppearance(Protocol):
    """How a person looks, which hands and cameras follow as they are before a round."""

    def targets(self, state: OffsetFit) -> Sequence[VertexTargets]:
        """Find where the pictures have visible vertices."""
        ...

    def surface(self, state: OffsetFit) -> OutlinedGeometry | None:
        """Pose the surface that has the outlines; None: the meshes have them."""
        ...


def fitted_offsets(
    start: RigFit,
    hands: RigHands,
    cameras: Sequence[Camera],
    outlines: ViewOutlines,
    targets: LandmarkTargets,
    held_out: Collection[int] = (),
    appearance: HandAppearance | None = None,
    offset_m: Float[Tensor, "S V"] | None = None,
    rounds: int = ROUNDS,
) -> OffsetFit:
    """Fit offsets, poses, the one shape and turns; held-out cameras are turned afterwards.

    Args:
        start: of the fit to outlines.
        hands: the model.
        cameras: as their files have them.
        outlines: of the pictures.
        targets: the landmarks of the pictures, which turn held-out cameras.
        held_out: rows of views that may not move the hands.
        appearance: None: the outlines of the meshes alone.
        offset_m: to start with; None: zeros.
        rounds: of pairs.
    """
    stacked, rows = RigCameras.of(cameras), [row for row in range(len(cameras)) if row not in held_out]
    smooth, laplacian = _SMOOTH_WEIGHT if appearance is None else _SMOOTH_WEIGHT_OF_TARGETS, _laplacian(hands)
    zeros = torch.zeros(len(hands.sides), len(hands.arm))
    state = OffsetFit(start, zeros if offset_m is None else offset_m)
    for _ in range(rounds):
        given = () if appearance is None else appearance.targets(state)
        surface = None if appearance is None else appearance.surface(state)
        normals = hands.posed_normals(state.fit.parameters)
        offset = normals * state.offset_m[..., None]
        pairs = paired(state.fit, hands, cameras, outlines, rows, _REACH_MM, offset, 0.0, surface)

        def picture(parameters: HandParameters, offset_m: Tensor, turns: Tensor) -> Tensor:
            shown = hands.show(parameters, normals * offset_m[..., None])  # noqa: B023
            loss = picture_loss(shown.all_vertices, shown.landmarks, turns, stacked, pairs, None, _ACROSS_MM)  # noqa: B023
            return loss + _target_loss(shown.vertices, turns, stacked, given)  # noqa: B023

        state = _moved(state, start, picture, smooth, laplacian, hands.skin.arm_weights)
    offset = hands.posed_normals(state.fit.parameters) * state.offset_m[..., None]
    surface = None if appearance is None else appearance.surface(state)
    fit = with_turned_cameras(state.fit, hands, cameras, outlines, targets, held_out, offset, surface)
    return state._replace(fit=fit)


def _moved(
    state: OffsetFit,
    start: RigFit,
    picture: Callable[[HandParameters, Tensor, Tensor], Tensor],
    smooth: float,
    laplacian: Tensor,
    arm_weights: Tensor,
) -> OffsetFit:
    values = [value.clone().requires_grad_() for value in (*state.fit.parameters, state.offset_m, state.fit.turns)]
    groups = [{"params": [value], "lr": rate} for value, rate in zip(values, _RATES, strict=True)]
    optimizer, first = torch.optim.Adam(groups, betas=(0.9, 0.98)), start.parameters
    for step in range(_STEPS):
        for group, rate in zip(optimizer.param_groups, _RATES, strict=True):
            group["lr"] = rate * (1 - (1 - _LAST_RATE) * step / _STEPS)
        theta, beta, transl, forearm, offset_m, turns = values
        loss = picture(HandParameters(theta, beta, transl, forearm), offset_m, turns)
        loss = loss + _THETA_WEIGHT * ((theta - first.theta)[:, 1:] ** 2).sum() + _BETA_WEIGHT * (beta**2).sum()
        loss = loss + _FOREARM_WEIGHT * ((forearm - first.forearm) ** 2).sum()
        loss = loss + _offset_cost(offset_m, smooth, laplacian, arm_weights)
        loss = loss + _TURN_WEIGHT * (((turns - start.turns) / _TURN_RAD) ** 2).sum(1).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    *parameters, offset_m, turns = (value.detach() for value in values)
    return OffsetFit(RigFit(HandParameters(*parameters), turns), offset_m)


def _offset_cost(offset_m: Tensor, smooth: float, laplacian: Tensor, arm_weights: Tensor) -> Tensor:
    offset_mm = offset_m.T * 1000  # [V, S]
    rough = smooth * (torch.sparse.mm(laplacian, offset_mm) ** 2).mean(0)
    arm = _ARM_WEIGHT * ((offset_mm * arm_weights[:, None]) ** 2).mean(0)
    return (rough + _SMALL_WEIGHT * (offset_mm**2).mean(0) + arm).sum()


def _target_loss(vertices: Tensor, turns: Tensor, cameras: RigCameras, given: Sequence[VertexTargets]) -> Tensor:
    loss = vertices.new_zeros(())
    for part in given:
        px = cameras.project(vertices[part.hand, part.vertex], part.view, turns[part.view])[0]
        off = (px - part.px).norm(dim=-1) / part.px_per_mm / _TARGET_MM
        robust = part.weight * ((1 + off**2).sqrt() - 1)
        loss = loss + _TARGET_WEIGHT * _TARGET_MM**2 * robust.sum() / (part.weight.sum() + _FEW) / len(given)
    return loss


def _laplacian(hands: RigHands) -> Tensor:
    """Build [V, V]: the mean of a vertex's neighbours less itself."""
    count = len(hands.arm)
    faces = hands.faces[: len(hands.faces) // len(hands.sides)].numpy() % count
    both = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    both = np.unique(np.concatenate([both, both[:, ::-1]]), axis=0)
    degree = np.bincount(both[:, 0], minlength=count)
    index = torch.as_tensor(np.concatenate([both.T, np.stack([np.arange(count)] * 2)], 1).copy())
    values = torch.as_tensor(np.concatenate([1 / degree[both[:, 0]], -np.ones(count)]), dtype=torch.float32)
    return torch.sparse_coo_tensor(index, values, (count, count), check_invariants=True).coalesce()
