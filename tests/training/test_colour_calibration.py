"""Gains and biases of cameras: by hand, fitted to tinted images, and built into an avatar."""

from dataclasses import replace

import pytest
import torch
from livehand.backend.avatars.avatar import PRESETS, new_avatar
from livehand.backend.avatars.file import load_avatar, save_avatar
from livehand.backend.records.errors import LiveHandError
from livehand.backend.training.colour_calibration import LEARNING_RATE, ColourCalibration, training_cameras


def tinted(count=3, fixed=0, seed=0):
    calibration, generator = ColourCalibration(count, fixed), torch.Generator().manual_seed(seed)
    with torch.no_grad():
        calibration.gain_offset += 0.2 * torch.randn(count, 3, generator=generator)
        calibration.bias += 0.05 * torch.randn(count, 3, generator=generator)
    return calibration


def image_of(height=6, width=8, seed=1):
    generator = torch.Generator().manual_seed(seed)
    alpha = (torch.rand(1, height, width, generator=generator) - 0.3).clamp(0, 1)
    return torch.cat([torch.rand(3, height, width, generator=generator) * alpha, alpha])


def test_it_starts_as_the_identity():
    image = image_of()
    assert torch.equal(ColourCalibration(4)(image, 2), image)


def test_gain_and_bias_act_on_the_hand_alone():
    calibration, image = tinted(), image_of()
    ours = calibration(image, 1)
    straight = image[:3] / image[3:].clamp(min=1e-9)
    gain, bias = 1 + calibration.gain_offset[1], calibration.bias[1]
    expected = (straight * gain[:, None, None] + bias[:, None, None]) * image[3:]
    torch.testing.assert_close(ours[:3], expected)
    assert torch.equal(ours[3], image[3])
    assert (image[3] == 0).any()
    assert ours[:, image[3] == 0].abs().max() == 0


def test_the_fixed_camera_is_never_changed():
    calibration, image = tinted(fixed=2), image_of()
    assert torch.equal(calibration(image, 2), image)
    calibration(image, 2).sum().backward()
    assert calibration.gain_offset.grad.abs().max() == 0
    assert calibration.bias.grad.abs().max() == 0
    calibration(image, 1).sum().backward()
    assert calibration.gain_offset.grad[1].abs().min() > 0
    assert calibration.bias.grad[1].abs().min() > 0
    assert calibration.gain_offset.grad[[0, 2]].abs().max() == 0


def fitted(images, is_calibrated):
    """An image, in place of the avatar, fitted to the images of several cameras, one camera per step."""
    calibration = ColourCalibration(len(images))
    image = torch.full_like(images[0], 0.3).requires_grad_()
    groups = [{"params": [image], "lr": 2e-2}]
    if is_calibrated:
        groups.append({"params": list(calibration.parameters()), "lr": 40 * LEARNING_RATE})
    optimiser = torch.optim.Adam(groups, betas=(0.9, 0.99))
    rates, steps = [group["lr"] for group in groups], 500
    for step in range(steps):
        for group, rate in zip(optimiser.param_groups, rates, strict=True):
            group["lr"] = rate * (1 - step / steps)
        camera = step * 7 % len(images)
        seen = calibration(image, camera)
        optimiser.zero_grad()
        ((seen - images[camera]) ** 2).sum().backward()
        optimiser.step()
    return image.detach(), calibration


def test_tints_are_recovered_and_the_image_is_better_for_it():
    truth, image = tinted(4), image_of(12, 16)
    images = [truth(image, camera).detach() for camera in range(4)]
    with_it, calibration = fitted(images, True)
    without, _ = fitted(images, False)
    for camera in range(4):
        for ours, expected in zip(calibration.of_cameras([camera]), truth.of_cameras([camera]), strict=True):
            torch.testing.assert_close(ours, expected, atol=0.02, rtol=0)
    error, error_without = ((fit - image)[:3].square().mean().sqrt() for fit in (with_it, without))
    assert error < 0.01
    assert error_without > 5 * error


def test_the_training_cameras_are_the_captures(painted_capture):
    assert training_cameras(painted_capture) == [0, 1, 2]  # the fourth is held out


@pytest.mark.parametrize("kind", ["light", "paper"])
def test_the_colours_of_cameras_can_be_built_in(small, kind, tmp_path):
    config = replace(small, superres=replace(small.superres, kind=kind))
    avatar, calibration = new_avatar("a", "hand", "0", config), tinted()
    maps = torch.rand(1, 33, 6, 8, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        for parameter in avatar.superres.parameters():
            parameter += 0.01
        plain = avatar.superres(maps)
        for cameras in ([1], [0, 1, 2]):
            tinted_avatar = calibration.with_colours_of(avatar, cameras)
            gain, bias = (values[:, None, None] for values in calibration.of_cameras(cameras))
            expected = torch.cat([gain * plain[0, :3] + bias * plain[0, 3:], plain[0, 3:]])
            torch.testing.assert_close(tinted_avatar.superres(maps)[0], expected)
        torch.testing.assert_close(avatar.superres(maps), plain)
        save_avatar(tinted_avatar, tmp_path / "a.safetensors")
        back = load_avatar(tmp_path / "a.safetensors")
        assert back.config == tinted_avatar.config
        torch.testing.assert_close(back.superres(maps)[0], expected, atol=2e-3, rtol=1e-2)


def test_the_presets_have_no_tint():
    for preset in PRESETS.values():
        assert preset.superres.gain == (1, 1, 1)
        assert preset.superres.bias == (0, 0, 0)


def test_unknown_cameras_are_refused():
    with pytest.raises(LiveHandError, match="one of 3 from 0, got 3"):
        ColourCalibration(3, 3)
    for cameras in ([], [0, 3], [-1]):
        with pytest.raises(LiveHandError, match="some of 3 from 0"):
            ColourCalibration(3).of_cameras(cameras)
