"""A hand's colours brought to a plate's: exposure, gain and bias, as a camera would have changed them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...backend.records.shot import Frame


@dataclass(frozen=True)
class Grade:
    """What becomes of linear Rec.709 colour: `rgb * 2**exposure_stops * gain + bias`.

    Attributes:
        exposure_stops: 1 doubles the light.
        gain: a factor for each of R, G, B.
        bias: what is added to each of R, G, B after that.
    """

    exposure_stops: float = 0.0
    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @classmethod
    def of_hand(cls, armature: bpy.types.Object) -> Grade:
        """The *Match Plate* settings; give the evaluated armature, which holds the keyed values of its frame."""
        hand = armature.livehand
        return cls(hand.exposure, tuple(hand.gain), tuple(hand.bias))


def graded(frame: Frame, grade: Grade) -> Frame:
    """The frame in other colours; alpha and depth stay. A grade that changes nothing gives the same frame.

    Colour below zero, which a negative bias makes, is cut off.
    """
    if grade == Grade():
        return frame
    factor = np.float32(2.0**grade.exposure_stops) * np.asarray(grade.gain, np.float32)
    # Colour is premultiplied, and so must be what is added to it.
    rgb = frame.rgb * factor + frame.alpha[..., None] * np.asarray(grade.bias, np.float32)
    return replace(frame, rgb=np.maximum(rgb, 0))
