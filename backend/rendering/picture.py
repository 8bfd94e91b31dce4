"""From each hand's own frames to the picture: who hides whom, the mean over the exposure, and the scene around."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...backend.records.shot import Frame, empty_frame
from ...backend.rendering.composition import SceneLayer, joined, mean_frame, over, visible_parts
from ...backend.rendering.frame_task import ExposureFrames
from ..scene.grade import graded
from .frame_setup import FrameSetup

if TYPE_CHECKING:
    from ...backend.rendering.surface_maps import SurfaceMaps

_SOLID_ALPHA = 0.5


@dataclass(frozen=True)
class Picture:
    """All that a view layer's passes are made of, in the scene's working space.

    Attributes:
        combined: the hands in their scene, or on transparent ground.
        hands: the hands as they are seen past each other, unhidden by the scene, on transparent ground.
        visible_alpha: [H, W] how much of each pixel is hand.
        coverage: mesh's name -> [H, W] how much of each pixel is that hand.
        surface: of the nearest hand's mesh; None where no pass asks for it.
    """

    combined: Frame
    hands: Frame
    visible_alpha: np.ndarray
    coverage: Mapping[str, np.ndarray]
    surface: SurfaceMaps | None

    @property
    def is_hand(self) -> np.ndarray:
        """[H, W] where passes that cannot be mixed tell of the hand."""
        return self.visible_alpha >= _SOLID_ALPHA


def draw_picture(
    stage: FrameSetup,
    moments: Sequence[ExposureFrames],
    size_px: tuple[int, int],
    convert: Callable[[Frame], Frame],
    around: SceneLayer | None,
    needs_surface: bool,
) -> Picture:
    """Compose what was rendered.

    Args:
        stage: the hands.
        moments: their frames.
        size_px: of the picture.
        convert: a frame into the scene's colours.
        around: what stands around the hands, in the working space; None: nothing.
        needs_surface: whether to make the surface's maps.
    """
    grades = [actor.grade for actor in stage.actors]
    moments = [
        tuple(convert(graded(frame, grade)) for frame, grade in zip(moment, grades, strict=True)) for moment in moments
    ]
    alone = [visible_parts(moment) for moment in moments]
    shown = alone if around is None else [visible_parts(moment, around.depth) for moment in moments]
    visible = _mean(shown, size_px)
    return Picture(
        combined=visible if around is None else over(visible, around),
        hands=visible if around is None else _mean(alone, size_px),
        visible_alpha=visible.alpha,
        coverage=_coverage(stage, shown),
        surface=_surface(stage) if needs_surface and stage.actors else None,
    )


def _mean(exposure: Sequence[Sequence[Frame]], size_px: tuple[int, int]) -> Frame:
    """Of every moment's parts, joined; empty of no hand, which has no moment."""
    return mean_frame([joined(parts) for parts in exposure]) if exposure else empty_frame(size_px)


def _coverage(stage: FrameSetup, shown: Sequence[Sequence[Frame]]) -> dict[str, np.ndarray]:
    by_hand = zip(*shown, strict=True)
    return {
        actor.mesh_name: np.mean([part.alpha for part in parts], axis=0)
        for actor, parts in zip(stage.actors, by_hand, strict=True)
    }


def _surface(stage: FrameSetup) -> SurfaceMaps:
    """At the moment nearest to the frame itself: mean normals or places lie nowhere."""
    from ...backend.rendering.surface_maps import (  # bring torch, which may be missing until a render
        nearest_maps,
        surface_maps,
    )

    shots = (task.shot for task in stage.task.moments[0])
    return nearest_maps([surface_maps(shot, actor.model) for shot, actor in zip(shots, stage.actors, strict=True)])
