"""One picture of a person's hand with what is known about it: what every source gives, and every step takes.

Sources are films, photographs and calibrated cameras; steps are the fits of light, poses, shape and skin. Pictures are
of right hands: those of a left one are mirrored, with their cameras and poses, by whoever reads them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .camera import Camera
from .errors import LiveHandError
from .shot import HandPose
from .side import Side

BACKGROUND, HAND, UNKNOWN = 0, 1, 2
"""Labels of pixels. What another hand, a sleeve or a ring hides is unknown: neither the hand's, nor free of it."""


@dataclass(frozen=True)
class HandPicture:
    """A picture of one hand.

    Attributes:
        name: of its file or frame, for people.
        rgb: [H, W, 3] uint8, sRGB-encoded.
        labels: [H, W] uint8: `BACKGROUND`, `HAND` or `UNKNOWN`.
        camera: of the picture, in the scene's world.
        pose: of the hand in that world, a right hand's.
        camera_index: pictures of one camera share its colours.
        scene: pictures of one scene share the light, which rests in its world.
        log_gain: [3] logarithm of its exposure and white balance over those of the scene's other pictures, if known.
        is_held_out: kept from all fits but that of its own pose, to measure them.
        moment: pictures of one moment show one pose, in one world; None: no other does.
        sighted: the pose as landmarks gave it, to whose bends fits keep fingers near; None: to those of `pose`.
    """

    name: str
    rgb: np.ndarray = field(repr=False)
    labels: np.ndarray = field(repr=False)
    camera: Camera
    pose: HandPose
    camera_index: int = 0
    scene: int = 0
    is_held_out: bool = False
    log_gain: tuple[float, float, float] = (0.0, 0.0, 0.0)
    moment: int | None = None
    sighted: HandPose | None = None

    def __post_init__(self):
        width, height = self.camera.size_px
        if self.rgb.shape != (height, width, 3) or self.labels.shape != (height, width):
            raise LiveHandError(
                f"{self.name} must be {width} x {height} pixels with a label each, got "
                f"{self.rgb.shape[1]} x {self.rgb.shape[0]} and {self.labels.shape[1]} x {self.labels.shape[0]}"
            )
        if self.pose.side != "right":
            raise LiveHandError(f"{self.name} must be of a right hand, got a left one's pose; mirror the picture")


@dataclass(frozen=True)
class PicturedHand:
    """All pictures of one hand.

    Attributes:
        pictures: in any order.
        side: of the hand that was pictured; a left one's pictures are mirrored.
        source: of the pictures, for the avatar's provenance.
        offset_m: [V] of the person's shape, along the normals of the template at rest; None: not known.
        is_calibrated: whether cameras and poses were fitted together, and are surer than flow against another skin.
        notes: what people should know of the source: pictures left out, skin that was not seen, a guessed focal length.
    """

    pictures: tuple[HandPicture, ...]
    side: Side
    source: str
    offset_m: np.ndarray | None = None
    is_calibrated: bool = False
    notes: tuple[str, ...] = ()
