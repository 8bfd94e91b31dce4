"""A hand's colours matched to a plate by exposure, gain and bias, as a camera would have changed them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..records.frame import Frame


@dataclass(frozen=True)
class Grade:
    """A change of linear Rec.709 colour: `rgb * 2**exposure_stops * gain + bias`.

    Attributes:
        exposure_stops: 1 doubles the light.
        gain: one factor for each of R, G, B.
        bias: added to each of R, G, B after the gain.
    """

    exposure_stops: float = 0.0
    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)


def graded(frame: Frame, grade: Grade) -> Frame:
    """Grade the colours of the frame; alpha and depth do not change. A neutral grade returns the same frame.

    Colours that a negative bias pushes below zero are clipped.
    """
    if grade == Grade():
        return frame
    factor = np.float32(2.0**grade.exposure_stops) * np.asarray(grade.gain, np.float32)
    # Colour is premultiplied, so the bias must be, too.
    rgb = frame.rgb * factor + frame.alpha[..., None] * np.asarray(grade.bias, np.float32)
    return replace(frame, rgb=np.maximum(rgb, 0))
