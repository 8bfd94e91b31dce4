"""The picture of a view layer, from each hand's own frames: occlusion, the mean over the exposure, the scene around."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..image.grade import graded
from ..records.frame import Frame, empty_frame
from .composition import SceneLayer, joined, mean_frame, over, visible_parts
from .frame_task import ExposureFrames, FrameTask, HandInstance

_SOLID_ALPHA = 0.5


@dataclass(frozen=True)
class Picture:
    """What a view layer's passes are made of, in the scene's working space.

    Attributes:
        combined: the hands in their scene, or on transparent ground.
        hands: the hands, hidden by each other but not by the scene, on transparent ground.
        visible_alpha: [H, W] how much of each pixel is hand.
        coverage: mesh name -> [H, W] how much of each pixel is that hand.
        surface: name -> map of the nearest hand's mesh, as `SurfaceMaps` has them; None if no pass needs them.
    """

    combined: Frame
    hands: Frame
    visible_alpha: np.ndarray
    coverage: Mapping[str, np.ndarray]
    surface: Mapping[str, np.ndarray] | None

    @property
    def is_hand(self) -> np.ndarray:
        """[H, W] where passes that cannot be mixed show the hand."""
        return self.visible_alpha >= _SOLID_ALPHA


def compose_picture(
    hands: Sequence[HandInstance],
    samples: Sequence[ExposureFrames],
    size_px: tuple[int, int],
    convert: Callable[[Frame], Frame],
    around: SceneLayer | None,
    surface: Mapping[str, np.ndarray] | None,
) -> Picture:
    """Compose the rendered frames.

    Args:
        hands: in the order of each sample's frames.
        samples: the frames of every exposure sample; none if there is no hand.
        size_px: of the picture.
        convert: changes a frame into the scene's colours.
        around: the scene around the hands, in the working space; None if there is none.
        surface: the maps of `surface_of`, if a pass needs them.
    """
    converted = [
        [convert(graded(frame, hand.grade)) for frame, hand in zip(sample, hands, strict=True)] for sample in samples
    ]
    alone = [visible_parts(frames) for frames in converted]
    shown = alone if around is None else [visible_parts(frames, around.depth) for frames in converted]
    visible = _mean(_without_holdouts(hands, shown), size_px)
    return Picture(
        combined=visible if around is None else over(visible, around, _hole(hands, shown, size_px)),
        hands=visible if around is None else _mean(_without_holdouts(hands, alone), size_px),
        visible_alpha=visible.alpha,
        coverage=_coverage(hands, shown),
        surface=surface,
    )


def _without_holdouts(hands: Sequence[HandInstance], samples: Sequence[Sequence[Frame]]) -> list[list[Frame]]:
    """Return the parts of each sample, of holdouts nothing."""
    return [
        [_nothing_like(part) if hand.is_holdout else part for hand, part in zip(hands, parts, strict=True)]
        for parts in samples
    ]


def _nothing_like(frame: Frame) -> Frame:
    height, width = frame.alpha.shape
    return empty_frame((width, height))


def _hole(hands: Sequence[HandInstance], samples: Sequence[Sequence[Frame]], size_px: tuple[int, int]) -> np.ndarray:
    """Average what holdouts cover of each pixel [H, W] over the exposure."""
    held = [part.alpha for parts in samples for hand, part in zip(hands, parts, strict=True) if hand.is_holdout]
    return sum(held, np.zeros(size_px[::-1], np.float32)) / max(len(samples), 1)


def _coverage(hands: Sequence[HandInstance], samples: Sequence[Sequence[Frame]]) -> dict[str, np.ndarray]:
    """Sum the coverage of each mesh's instances, which count together; holdouts, which cannot be seen, have none."""
    coverage: dict[str, np.ndarray] = {}
    for hand, parts in zip(hands, zip(*samples, strict=True), strict=True):
        if hand.is_holdout:
            continue
        alpha = np.mean([part.alpha for part in parts], axis=0)
        coverage[hand.mesh_name] = (
            np.minimum(coverage[hand.mesh_name] + alpha, 1) if hand.mesh_name in coverage else alpha
        )
    return coverage


def surface_of(
    hands: Sequence[HandInstance], task: FrameTask, motion: Sequence[np.ndarray] | None = None
) -> Mapping[str, np.ndarray] | None:
    """Compute the surface maps at the sample nearest to the frame itself (mean normals or positions mean nothing).

    None if the task has no hand that is seen. `motion` [V, 4] px is that of each hand's vertices, as in `SurfaceMaps`.
    """
    if not task.samples:
        return None
    every = zip(hands, task.samples[0], motion or [None] * len(hands), strict=True)
    seen = [(one, of_hand) for hand, one, of_hand in every if not hand.is_holdout]
    if not seen:
        return None
    from .surface_maps import nearest_maps, surface_maps  # torch, which may be missing until a hand is rendered

    return vars(nearest_maps([surface_maps(one.shot, one.renderer.hand, of_hand) for one, of_hand in seen]))


def _mean(samples: Sequence[Sequence[Frame]], size_px: tuple[int, int]) -> Frame:
    """Average the joined parts over the exposure; empty without a sample."""
    return mean_frame([joined(parts) for parts in samples]) if samples else empty_frame(size_px)
