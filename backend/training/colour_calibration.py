"""A gain and a bias per camera (paper, colour calibration): cameras of a rig never agree about colour.

They are learnt beside the avatar and applied to what it renders before that is compared, at both resolutions. They act
on the hand alone: colour is premultiplied, so the bias counts times alpha, and the empty background stays black.

One camera is fixed, as a common tint could be the look's as well as all cameras'. So the avatar looks as that camera
sees it, and another camera's look, or the mean one's, is worn only where it is asked for (`with_networks`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ..captures.capture import Capture
from ..nerf.avatar import Avatar
from ..nerf.superres import build_superres
from ..records.errors import LiveHandError

LEARNING_RATE = 5e-4
"""Of gains and biases, beside the networks' 2e-3: tints are few and seen in every image of their camera."""


def training_cameras(capture: Capture) -> list[int]:
    """The cameras of the capture's training images, by number; the first is the one to hold fixed."""
    return sorted({view.camera_index for view in capture.of_split("train")})


class ColourCalibration(nn.Module):
    """Gains [C, 3], 1 at the start, and biases [C, 3], 0 at the start, of C cameras by their number in the capture."""

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
        """A premultiplied picture as the camera would show it."""
        gain, bias = (values[:, None, None] for values in self.of_cameras([camera]))
        return torch.cat([gain * rgba[:3] + bias * rgba[3:], rgba[3:]])

    def of_cameras(self, cameras: Sequence[int]) -> tuple[Float[Tensor, 3], Float[Tensor, 3]]:
        """Mean gain and bias of some cameras.

        Raises:
            LiveHandError: there is no such camera.
        """
        if not cameras or min(cameras) < 0 or max(cameras) >= len(self.bias):
            raise LiveHandError(f"cameras must be some of {len(self.bias)} from 0, got {list(cameras)}")
        rows = list(cameras)
        gain, bias = 1 + self.is_free * self.gain_offset, self.is_free * self.bias
        return gain[rows].mean(0), bias[rows].mean(0)

    @torch.no_grad()
    def with_networks(self, avatar: Avatar, cameras: Sequence[int]) -> Avatar:
        """The avatar with the look that these cameras have in the mean; it renders so from then on."""
        gain, bias = (tuple(values.tolist()) for values in self.of_cameras(cameras))
        config = replace(avatar.config.superres, gain=gain, bias=bias)
        superres = build_superres(config)
        superres.load_state_dict(avatar.superres.state_dict())
        return replace(avatar, config=replace(avatar.config, superres=config), superres=superres)
