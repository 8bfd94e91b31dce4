"""A gain and a bias per camera (paper, colour calibration), as the cameras of a rig differ in colour.

They are trained with the avatar and applied to its renderings, at both resolutions, before the loss. They act on the
hand alone: colour is premultiplied, so the bias is multiplied by alpha, and the empty background stays black.

One camera is fixed, because a tint common to all cameras cannot be separated from the colour of the hand. The avatar
has the colours that this camera sees, unless other cameras are chosen (`ColourCalibration.with_colours_of`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ..avatars.avatar import Avatar
from ..capture.capture import Capture
from ..image.superres import build_superres
from ..records.errors import LiveHandError
from .parts import Correction, Rendered

LEARNING_RATE = 5e-4
"""Learning rate of gains and biases; lower than the networks', as each of them sees every image of its camera."""


def training_cameras(capture: Capture) -> list[int]:
    """List the cameras of the capture's training images, in ascending order; the first is held fixed."""
    return sorted({view.camera_index for view in capture.of_split("train")})


class ColourCalibration(nn.Module):
    """Gains [C, 3], initially 1, and biases [C, 3], initially 0, of C cameras, indexed as in the capture."""

    is_free: Tensor

    def __init__(self, camera_count: int, fixed_camera: int = 0):
        super().__init__()
        if not 0 <= fixed_camera < camera_count:
            raise LiveHandError(f"the fixed camera must be one of {camera_count} from 0, got {fixed_camera}")
        self.gain_offset = nn.Parameter(torch.zeros(camera_count, 3))
        self.bias = nn.Parameter(torch.zeros(camera_count, 3))
        is_free = torch.ones(camera_count, 1)
        is_free[fixed_camera] = 0
        self.register_buffer("is_free", is_free)

    def forward(self, rgba: Float[Tensor, "4 H W"], camera: int) -> Float[Tensor, "4 H W"]:
        """Convert a premultiplied image to the colours of a camera."""
        gain, bias = (values[:, None, None] for values in self.of_cameras([camera]))
        return torch.cat([gain * rgba[:3] + bias * rgba[3:], rgba[3:]])

    def of_cameras(self, cameras: Sequence[int]) -> tuple[Float[Tensor, 3], Float[Tensor, 3]]:
        """Average gain and bias of the given cameras.

        Raises:
            LiveHandError: there is no such camera.
        """
        if not cameras or min(cameras) < 0 or max(cameras) >= len(self.bias):
            raise LiveHandError(f"cameras must be some of {len(self.bias)} from 0, got {list(cameras)}")
        rows = list(cameras)
        gain, bias = 1 + self.is_free * self.gain_offset, self.is_free * self.bias
        return gain[rows].mean(0), bias[rows].mean(0)

    @torch.no_grad()
    def with_colours_of(self, avatar: Avatar, cameras: Sequence[int]) -> Avatar:
        """Build the mean gain and bias of these cameras into the avatar."""
        gain, bias = (tuple(values.tolist()) for values in self.of_cameras(cameras))
        config = replace(avatar.config.superres, gain=gain, bias=bias)
        superres = build_superres(config)
        superres.load_state_dict(avatar.superres.state_dict())
        return replace(avatar, config=replace(avatar.config, superres=config), superres=superres)


def camera_colours(capture: Capture, avatar_cameras: Sequence[int], learning_rate: float = LEARNING_RATE) -> Correction:
    """Make gains and biases per camera; the avatar gets those of `avatar_cameras` or, if empty, of the fixed camera.

    Raises:
        LiveHandError: there is no such camera.
    """
    cameras = training_cameras(capture)
    calibration = ColourCalibration(max(cameras) + 1, fixed_camera=cameras[0])
    if avatar_cameras:
        calibration.of_cameras(avatar_cameras)  # checks the numbers before training starts

    return Correction(
        name="camera_colours",
        module=calibration,
        learning_rate=learning_rate,
        after=lambda rendered, source: Rendered(*(calibration(maps, source.camera_index) for maps in rendered)),
        finish=lambda avatar: calibration.with_colours_of(avatar, avatar_cameras) if avatar_cameras else avatar,
        settings={"worn_cameras": list(avatar_cameras)},
    )
