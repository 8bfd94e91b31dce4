"""The road from a rig's views to hands, cameras and labels: every stage in its order, and what it measured.

Landmarks of all views are associated and calibrate the cameras; a pose for all; masks; outlines; masks again; offsets.
It is deterministic: no stage draws random numbers but GrabCut, whose seed is fixed.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from ...hand.model import HandModel
from ...records.camera import Camera
from ...records.errors import LiveHandError
from ...records.shot import HandPose
from ...records.side import SIDES, Side
from ...system.thread_limits import thread_limit
from ...tracking.weights import TrackerNetworks
from .association import AssociatedHand, associated_hands, found_hands, with_second_look
from .calibration import LEAST_VIEWS, RigView
from .forearm_search import with_forearms
from .landmark_pose import landmark_poses, landmark_targets
from .outline_fit import RigFit, ViewOutlines, fitted_to_outlines
from .outlines import covered_pixels
from .rig_cameras import RigCameras, turned
from .rig_hands import RigHands
from .self_calibration import OFF_PX, calibrated, cameras_off_px
from .shape_offsets import OffsetFit, fitted_offsets
from .view_masks import mesh_labels, overlap, relabelled, view_labels

Say = Callable[[str], None]
_ZOOMED_PERCENT = 1


@dataclass(frozen=True)
class FittedRig:
    """What a rig shows.

    Attributes:
        poses: by side, with one shape, in the cameras' world.
        offset_m: by side, [V] along the normals of the template at rest.
        cameras: of all views, turned.
        labels: of all views, [H, W] as `view_masks` has them.
        meshes: the labels of the posed meshes alone.
        px_per_mm: px in a millimetre at the hands, of each view.
        turns: [C, 4] from the cameras of the files, as `rig_cameras` has them.
        off_px: rows of cameras that are off by more than 5 px, and by how much.
        overlaps: by stage and side, [C] intersection over union of mesh and skin.
    """

    poses: dict[Side, HandPose]
    offset_m: dict[Side, np.ndarray]
    cameras: tuple[Camera, ...]
    labels: tuple[np.ndarray, ...]
    meshes: tuple[np.ndarray, ...]
    px_per_mm: tuple[float, ...]
    turns: np.ndarray
    off_px: dict[int, float]
    overlaps: dict[str, dict[Side, np.ndarray]]


def fitted_rig(
    views: Sequence[RigView],
    networks: TrackerNetworks,
    model: HandModel,
    held_out: Collection[int] = (),
    say: Say = lambda _: None,
) -> FittedRig:
    """Find and fit the hands that a rig shows.

    Args:
        views: of one instant, by at least three cameras.
        networks: of the tracker.
        model: any hand in MANO's format.
        held_out: rows of views that may not move the hands; their cameras are turned to them afterwards.
        say: is told what each stage found.

    Raises:
        LiveHandError: no hand is seen by three views or more that agree and are not held out.
    """
    with thread_limit(1):  # operations are small: threads would only wait for each other
        cameras = [view.camera for view in views]
        hands = associated_hands(found_hands(views, networks), cameras, model)
        hands = with_second_look(hands, views, networks)
        return fitted_hands(views, [hands[side] for side in SIDES if side in hands], model, held_out, say)


def fitted_hands(
    views: Sequence[RigView],
    found: Sequence[AssociatedHand],
    model: HandModel,
    held_out: Collection[int] = (),
    say: Say = lambda _: None,
) -> FittedRig:
    """Fit the hands that were found; as `fitted_rig`."""
    cameras, names = [view.camera for view in views], [view.camera_index for view in views]
    own = [_without(hand, held_out) for hand in found]
    own = [hand for hand in own if len(hand.finds) >= LEAST_VIEWS]
    if not own:
        raise LiveHandError(
            f"a hand must be seen by at least {LEAST_VIEWS} cameras that are not held out; hold out fewer"
        )
    kept: dict[Side, AssociatedHand] = {hand.side: hand for hand in found if hand.side in {one.side for one in own}}
    calibration = calibrated(list(kept.values()), cameras, held_out)
    error_px = calibration.error_px
    say(f"landmarks: {np.nanmedian(error_px):.1f} px off, by camera {_by_name(names, error_px)}")
    turns = np.pad(calibration.turns, ((0, 0), (0, 1)))  # landmarks tell no zoom
    rows = [turned(camera, turn) for camera, turn in zip(cameras, turns, strict=True)]
    hands = RigHands.of(model, tuple(kept))
    poses = landmark_poses(own, rows, calibration.points, model).poses
    stages = _Stages(views, hands, names, held_out, say)
    parameters = with_forearms(hands.parameters(poses), hands, views, rows, held_out)
    say(f"forearms bent by {np.rad2deg(parameters.forearm.norm(dim=1).numpy()).round().tolist()} degrees")
    start = RigFit(parameters, torch.as_tensor(turns, dtype=torch.float32))
    state = OffsetFit(start, torch.zeros(len(hands.sides), len(hands.arm)))
    labels = stages.labels(state)
    targets = landmark_targets(list(kept.values()), RigCameras.of(cameras))
    rgb = [view.rgb for view in views]
    outlines = ViewOutlines.of(labels, stages.px_per_mm(state), rgb)
    fit = fitted_to_outlines(start, hands, cameras, outlines, targets, held_out)
    fitted = OffsetFit(fit, state.offset_m)
    labels = stages.labels(fitted)
    for name, one in (("landmarks", state), ("outlines", fitted)):
        stages.measure(name, one, labels)
    outlines = ViewOutlines.of(labels, stages.px_per_mm(fitted), rgb)
    state = fitted_offsets(fit, hands, cameras, outlines, targets, held_out)
    stages.measure("offsets", state, labels)
    turns = state.fit.turns.double().numpy()
    off_px = cameras_off_px(turns, cameras)
    off_by_name = {names[row]: round(off, 1) for row, off in off_px.items()}
    say(f"cameras off by more than {OFF_PX:.0f} px: {off_by_name or 'none'}")
    zooms = {name: round(100 * zoom, 1) for name, zoom in zip(names, np.expm1(turns[:, 3]).tolist(), strict=True)}
    zoomed = {name: percent for name, percent in zooms.items() if abs(percent) > _ZOOMED_PERCENT}
    say(f"focal lengths off by more than {_ZOOMED_PERCENT} %: {zoomed or 'none'}")
    meshes = stages.meshes(state)
    return FittedRig(
        poses=hands.poses(state.fit.parameters),
        offset_m={side: state.offset_m[row].double().numpy() for row, side in enumerate(hands.sides)},
        cameras=tuple(stages.cameras(state)),
        labels=tuple(relabelled(*pair) for pair in zip(labels, meshes, strict=True)),
        meshes=tuple(meshes),
        px_per_mm=tuple(stages.px_per_mm(state)),
        turns=turns,
        off_px=off_px,
        overlaps=stages.overlaps,
    )


def _without(hand: AssociatedHand, rows: Collection[int]) -> AssociatedHand:
    return replace(hand, finds=tuple(find for find in hand.finds if find.view not in rows))


def _by_name(names: Sequence[int], values: np.ndarray) -> dict[int, float]:
    return {name: round(float(value), 1) for name, value in zip(names, values, strict=True)}


class _Stages:
    """What every stage is drawn and measured by."""

    def __init__(
        self, views: Sequence[RigView], hands: RigHands, names: Sequence[int], held_out: Collection[int], say: Say
    ):
        self._views, self._hands, self._names, self._say = views, hands, names, say
        self._is_held_out = np.isin(np.arange(len(views)), list(held_out))
        self._stacked = RigCameras.of([view.camera for view in views])
        self.overlaps: dict[str, dict[Side, np.ndarray]] = {}

    def vertices(self, state: OffsetFit) -> np.ndarray:
        """Pose the vertices of all hands, with their offsets, [S * V, 3] m."""
        offset = self._hands.posed_normals(state.fit.parameters) * state.offset_m[..., None]
        return self._hands.show(state.fit.parameters, offset).all_vertices.double().numpy()

    def cameras(self, state: OffsetFit) -> list[Camera]:
        """Turn the cameras."""
        turns = state.fit.turns.double().numpy()
        return [turned(view.camera, turn) for view, turn in zip(self._views, turns, strict=True)]

    def px_per_mm(self, state: OffsetFit) -> list[float]:
        """Compute px in a millimetre at the hands, of each view."""
        vertices = torch.as_tensor(self.vertices(state), dtype=torch.float32)
        return [self._stacked.px_per_m(row, vertices) / 1000 for row in range(len(self._views))]

    def labels(self, state: OffsetFit) -> list[np.ndarray]:
        """Label all views' pixels."""
        vertices = self.vertices(state)
        parts = zip(self._views, self.cameras(state), self.px_per_mm(state), strict=True)
        return [view_labels(view.rgb, vertices, self._hands, camera, scale) for view, camera, scale in parts]

    def meshes(self, state: OffsetFit) -> list[np.ndarray]:
        """Label all views' pixels by the meshes alone."""
        vertices = self.vertices(state)
        covered = (covered_pixels(vertices, self._hands.faces, camera) for camera in self.cameras(state))
        return [mesh_labels(one, self._hands) for one in covered]

    def measure(self, name: str, state: OffsetFit, labels: Sequence[np.ndarray]) -> None:
        """Keep and tell how far the meshes of a stage cover the skin; whose skin it is follows the meshes."""
        meshes = self.meshes(state)
        pairs = [(relabelled(*pair), pair[1]) for pair in zip(labels, meshes, strict=True)]
        own: dict[Side, np.ndarray] = {
            side: np.array([overlap(*pair, side) for pair in pairs]) for side in self._hands.sides
        }
        self.overlaps[name] = own
        for side, values in own.items():
            parts = values[~self._is_held_out], values[self._is_held_out]
            fitted, apart = (np.nanmean(part) if np.isfinite(part).any() else np.nan for part in parts)
            percent = _by_name(self._names, 100 * values)
            self._say(f"{name}, {side}: overlap {fitted:.3f}, held out {apart:.3f}, by camera {percent} %")
