"""Fits hands and cameras to the outlines of all views: iterated closest points, point to line.

In every round, the outlines of the posed meshes are paired with the pictures' by place and direction, and poses,
the one shape, forearms and the cameras' turns follow the pairs and the landmarks; the reach of pairs shrinks. Cameras
that are held out are turned afterwards to their own outlines and landmarks, the hands resting.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ...records.camera import Camera
from .landmark_pose import LandmarkTargets
from .outlines import OutlinedGeometry, OutlineTree, PairedViews, outline_pairs, outline_where, tells_edges
from .rig_cameras import RigCameras, turn_costs, turned
from .rig_hands import HandParameters, RigHands
from .view_masks import FREE

ROUNDS, HELD_OUT_ROUNDS = 8, 5
_STEPS = 70
_FARTHEST_MM, _NEAREST_MM, _SHRINKS = 20.0, 5.0, 0.75  # the reach of pairs, round by round
_EVERY = 2  # pixels of an outline that share a pair
_RATES = (0.006, 0.03, 0.0008, 0.01, 0.0004)  # of theta, beta, transl, forearm and turns
_LAST_RATE = 0.1  # of a round's, as a share of its first
ACROSS_MM, _LANDMARK_MM = 2.0, 4.0  # scales of robust residuals
_ACROSS_WEIGHT = 4.0  # of a square millimetre
_ALONG_WEIGHT, _MOST_ALONG_MM2 = 0.08, 25.0
_LANDMARK_WEIGHT = 0.6
_THETA_WEIGHT, _BETA_WEIGHT, _FOREARM_WEIGHT, _TURN_WEIGHT = 1.5, 0.02, 1.0, 0.02


class RigFit(NamedTuple):
    """Hands and cameras of a fit: parameters, and turns [C, 4] from the cameras of the files."""

    parameters: HandParameters
    turns: Tensor


class ViewOutlines(NamedTuple):
    """The outlines of all skin in the pictures: a search tree and the px in a millimetre of each view, by row."""

    trees: Mapping[int, OutlineTree]
    px_per_mm: Mapping[int, float]

    @classmethod
    def of(
        cls, labels: Sequence[np.ndarray], px_per_mm: Sequence[float], pictures: Sequence[np.ndarray] | None = None
    ) -> ViewOutlines:
        """Find the outlines of views labelled by `view_labels`.

        Args:
            labels: of the views.
            px_per_mm: px in a millimetre at the hands.
            pictures: [H, W, 3] of the views, whose bright grounds have no outlines; None: all count.
        """
        trees = {}
        for row, part in enumerate(labels):
            is_known = np.ones(part.shape, bool) if pictures is None else tells_edges(pictures[row], part == FREE)
            trees[row] = OutlineTree(outline_where(part != FREE, is_known), px_per_mm[row], is_known)
        return cls(trees, dict(enumerate(px_per_mm)))


def fitted_to_outlines(
    start: RigFit,
    hands: RigHands,
    cameras: Sequence[Camera],
    outlines: ViewOutlines,
    targets: LandmarkTargets,
    held_out: Collection[int] = (),
    rounds: int = ROUNDS,
) -> RigFit:
    """Fit hands and cameras.

    Args:
        start: poses and turns of a fit to landmarks.
        hands: the model.
        cameras: as their files have them.
        outlines: of the pictures.
        targets: the landmarks of the pictures.
        held_out: rows of views that may not move the hands.
        rounds: of pairs.
    """
    stacked, fit = RigCameras.of(cameras), start
    rows = [row for row in range(len(cameras)) if row not in held_out]
    own = targets.in_views(rows)
    for number in range(rounds):
        pairs = paired(fit, hands, cameras, outlines, rows, reach_mm(number))
        fit = _moved(fit, start, hands, stacked, pairs, own, frozenset(rows))
    return with_turned_cameras(fit, hands, cameras, outlines, targets, held_out)


def with_turned_cameras(
    fit: RigFit,
    hands: RigHands,
    cameras: Sequence[Camera],
    outlines: ViewOutlines,
    targets: LandmarkTargets,
    rows: Collection[int],
    offset: Tensor | None = None,
    surface: OutlinedGeometry | None = None,
) -> RigFit:
    """Turn the cameras of these rows to their outlines and landmarks; the hands and the cameras' zooms rest."""
    stacked, rows = RigCameras.of(cameras), sorted(rows)
    own = targets.in_views(rows)
    with torch.no_grad():
        shown = hands.show(fit.parameters, offset)
    for number in range(HELD_OUT_ROUNDS if rows else 0):
        pairs = paired(fit, hands, cameras, outlines, rows, reach_mm(number), offset, surface=surface)
        turns = fit.turns.clone().requires_grad_()
        optimizer = torch.optim.Adam([turns], lr=_RATES[-1], betas=(0.9, 0.98))
        for step in range(_STEPS):
            _set_rates(optimizer, _RATES[-1:], step)
            loss = picture_loss(shown.all_vertices, shown.landmarks, turns, stacked, pairs, own)
            loss = loss + _TURN_WEIGHT * turn_costs(turns).sum()
            optimizer.zero_grad()
            loss.backward()
            _keep_still(turns, rows)
            if turns.grad is not None:
                turns.grad[:, 3] = 0
            optimizer.step()
        fit = fit._replace(turns=turns.detach())
    return fit


def reach_mm(number: int) -> float:
    """Compute how far apart a round's pairs may lie."""
    return max(_NEAREST_MM, _FARTHEST_MM * _SHRINKS**number)


def paired(
    fit: RigFit,
    hands: RigHands,
    cameras: Sequence[Camera],
    outlines: ViewOutlines,
    rows: Sequence[int],
    reach: float,
    offset: Tensor | None = None,
    arm_reach: float = 0.6,
    surface: OutlinedGeometry | None = None,
) -> PairedViews:
    """Pair the outlines of the posed hands with those of the pictures in these rows, at most `reach` mm apart.

    The hands' surface is that of their meshes, or the finer one that is given.
    """
    with torch.no_grad():
        vertices = hands.show(fit.parameters, offset).all_vertices
    surface = surface or OutlinedGeometry.of_meshes(vertices.double().numpy(), hands)
    found = []
    for row in rows:
        camera = turned(cameras[row], fit.turns[row].double().numpy())
        view = (camera, row, outlines.trees[row], outlines.px_per_mm[row])
        found.append(outline_pairs(surface, *view, reach, arm_reach, _EVERY))
    return PairedViews.of(found, surface, vertices)


def picture_loss(
    vertices: Tensor,
    landmarks: Tensor,
    turns: Tensor,
    cameras: RigCameras,
    pairs: PairedViews,
    targets: LandmarkTargets | None,
    across_mm: float = ACROSS_MM,
) -> Tensor:
    """Sum the robust residuals of outlines and landmarks, each the mean of the views'."""
    loss, count = vertices.new_zeros(()), max(len(pairs.views), 1)
    for part, points in zip(pairs.views, pairs.points(vertices), strict=True):
        across, along = part.off_mm(cameras.project(points, part.view, turns[part.view])[0])
        robust = across_mm**2 * ((1 + (across / across_mm) ** 2).sqrt() - 1).mean()
        along = (along**2).clamp(max=_MOST_ALONG_MM2).mean()
        loss = loss + (_ACROSS_WEIGHT * robust + _ALONG_WEIGHT * along) / count
    if targets is not None and len(targets.view):
        off = targets.off_mm(cameras, landmarks, turns) / _LANDMARK_MM
        loss = loss + _LANDMARK_WEIGHT * torch.log1p(off**2).mean()
    return loss


def _moved(
    fit: RigFit,
    start: RigFit,
    hands: RigHands,
    cameras: RigCameras,
    pairs: PairedViews,
    targets: LandmarkTargets,
    rows: frozenset[int],
) -> RigFit:
    """Move hands and cameras towards one round's pairs."""
    values = [value.clone().requires_grad_() for value in (*fit.parameters, fit.turns)]
    groups = [{"params": [value], "lr": rate} for value, rate in zip(values, _RATES, strict=True)]
    optimizer = torch.optim.Adam(groups, betas=(0.9, 0.98))
    first = start.parameters
    for step in range(_STEPS):
        _set_rates(optimizer, _RATES, step)
        theta, beta, transl, forearm, turns = values
        shown = hands.show(HandParameters(theta, beta, transl, forearm))
        loss = picture_loss(shown.all_vertices, shown.landmarks, turns, cameras, pairs, targets)
        loss = loss + _THETA_WEIGHT * ((theta - first.theta)[:, 1:] ** 2).sum() + _BETA_WEIGHT * (beta**2).sum()
        loss = loss + _FOREARM_WEIGHT * ((forearm - first.forearm) ** 2).sum()
        loss = loss + _TURN_WEIGHT * turn_costs(turns).sum()
        optimizer.zero_grad()
        loss.backward()
        _keep_still(turns, rows)
        optimizer.step()
    *parameters, turns = (value.detach() for value in values)
    return RigFit(HandParameters(*parameters), turns)


def _set_rates(optimizer: torch.optim.Optimizer, rates: Sequence[float], step: int) -> None:
    for group, rate in zip(optimizer.param_groups, rates, strict=True):
        group["lr"] = rate * (1 - (1 - _LAST_RATE) * step / _STEPS)


def _keep_still(turns: Tensor, rows: Collection[int]) -> None:
    """Take the slope from the turns of all cameras but these."""
    still = [row for row in range(len(turns)) if row not in rows]
    if turns.grad is not None:
        turns.grad[still] = 0
