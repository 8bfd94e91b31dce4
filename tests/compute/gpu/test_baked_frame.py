"""Whole frames in the light of a capture as one sequence, on Warp's CPU device and a GPU, against the CPU's."""

import logging
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import torch
import warp as wp
from livehand.backend.avatars.avatar import PRESETS, new_avatar
from livehand.backend.avatars.file import load_avatar
from livehand.backend.compute.cpu.backend import NumbaBackend
from livehand.backend.compute.gpu import baked_frame
from livehand.backend.compute.gpu.backend import WarpBackend
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.image.superres import SuperResConfig, build_superres
from livehand.backend.render.composition import joined, visible_parts
from livehand.backend.render.renderer import Renderer
from livehand.backend.training.setup import load_what_fits

from .test_lit_frame import NETWORKS
from .test_planted_faults import after, poison, scaled
from .whole_frames import FLIPPED, FLIPPED_OF_LEFT, assert_same_frame, kinds, off_by

pytestmark = pytest.mark.slow

KINDS = "right", "left", "past the border", "moving", "sculpted", "of another shape"
MOST_LAUNCHES = 30


@pytest.fixture(scope="module")
def avatar(hand):
    """With the shape of one that ships, colours that depend on all that its networks are given, and a grade."""
    superres = SuperResConfig(gain=(0.9, 1.0, 1.1), bias=(0.02, 0.0, -0.01))
    made = new_avatar("baked", hand.name, hand.sha256, replace(PRESETS["default"], superres=superres), seed=0)
    load_what_fits(made.field, load_avatar().field)
    rng = torch.Generator().manual_seed(1)
    with torch.no_grad():
        for layer, scale in ((made.field.channels, 0.2), (made.field.light, 1.0), (made.superres.tail, 0.003)):
            layer.weight.copy_(scale * torch.randn(layer.weight.shape, generator=rng))
        for layer in (made.superres.head, *made.superres.body):
            layer.bias.zero_()  # nothing beside the hand, as trained networks show
    return made


def warp_renderer(avatar, hand, device):
    return Renderer(avatar, hand, "cpu", "fp32", WarpBackend("cuda:0" if device.type == "cuda" else "cpu"))


@pytest.fixture(scope="module")
def renderers(avatar, hand, device):
    others = (Renderer(avatar, hand, "cpu", "fp32", backend) for backend in (NumbaBackend(), ReferenceBackend()))
    return [warp_renderer(avatar, hand, device), *others]


@pytest.fixture(scope="module")
def ours(renderers):
    return renderers[0]


@pytest.fixture(scope="module")
def expected(renderers):
    """Of the left hand."""
    return renderers[1].render(kinds()["left"])


def at_once(renderer, shot):
    with torch.inference_mode():
        frame = renderer.pipeline.at_once(shot)
    assert frame is not None
    return frame


def buffers_of(renderer, side="left"):
    frames = renderer.pipeline._shots._renderers[side]
    return next(reversed(frames._kept.values())).buffers


@pytest.mark.parametrize("other", [1, pytest.param(2, marks=pytest.mark.nightly)], ids=["the CPU's", "the reference's"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_frame_at_once_is(renderers, kind, other):
    shot = kinds()[kind]
    assert_same_frame(at_once(renderers[0], shot), renderers[other].render(replace(shot, quality="final")))


def test_a_frame_of_an_avatar_that_only_enlarges_is_the_cpus(avatar, hand, device):
    """The CPU's super-resolution takes what lies off the hand for nothing; without it frames differ by less."""
    plain = replace(avatar, superres=build_superres(avatar.config.superres))
    others = Renderer(plain, hand, "cpu", "fp32", NumbaBackend()).render(kinds()["left"])
    bound = FLIPPED_OF_LEFT if device.type == "cpu" else FLIPPED
    assert_same_frame(at_once(warp_renderer(plain, hand, device), kinds()["left"]), others, bound)


WRONG = {
    "shadows": ("fill_lit_share", scaled("lit", 0.5)),
    "codes of light": ("light_codes", scaled("vertex_channels", 1.2)),
    "what the field gathers": ("sum_samples", scaled("channels", 1.1)),
    "a decoder": ("baked_inputs", scaled("decoder_inputs", 1.1)),
    "super-resolution": ("paint_rays", scaled("padded", 5.0)),
    "maps": ("paint_rays", scaled("maps33", 1.05)),
}


@pytest.mark.parametrize("what", WRONG)
def test_a_wrong_value_is_seen(ours, expected, device, what, monkeypatch):
    if device.type != "cpu":
        pytest.skip("what a fault changes is no other on a GPU")
    at_once(ours, kinds()["left"])
    buffers, (kernel, plant) = buffers_of(ours), WRONG[what]
    monkeypatch.setattr(buffers.sequence, "_steps", after(buffers, kernel, lambda: plant(buffers)))
    assert off_by(at_once(ours, kinds()["left"]), expected) > FLIPPED


def test_networks_are_torchs(ours, device):
    at_once(ours, kinds()["left"])
    buffers, (width, height) = buffers_of(ours), buffers_of(ours).shape.size_px
    model, rays = buffers.model, int(buffers["counts"].numpy()[0])
    inputs = torch.as_tensor(buffers["decoder_inputs"].numpy()[:rays, : model.field.trunk[0].in_features]).float()
    maps = torch.as_tensor(buffers["maps33"].numpy()).T.reshape(1, -1, height, width)
    rows = torch.as_tensor(buffers["tail"].numpy()[: (height + 2) * (width + 2)]).reshape(height + 2, width + 2, -1)
    detail = torch.nn.functional.pixel_shuffle(rows[1:-1, 1:-1, :16].permute(2, 0, 1)[None], 2)
    with torch.no_grad():
        pairs = (
            (torch.as_tensor(buffers["raw"].numpy()[:rays, :32]), model.field.decoded(inputs)),
            (detail, model.superres.residual(maps)),
        )
    for one, other in pairs:
        assert other.abs().max() > 0.005
        assert (one - other).abs().max() < (2e-3 if device.type == "cuda" else NETWORKS) * other.abs().max()


def test_the_pipeline_renders_at_once_whatever_light_hair_and_objects_there_are(ours, renderers, monkeypatch):
    shot = kinds()["in fine shadows of objects"]
    monkeypatch.setattr(type(ours.pipeline), "field_conditions", lambda *_: pytest.fail("rendered stage by stage"))
    frame = ours.render(shot)
    assert ours.renders_at_once
    assert not renderers[1].renders_at_once
    assert np.array_equal(frame.rgb, at_once(ours, replace(shot, light=None, hair=0.0)).rgb)
    assert not frame.is_lit


def test_an_orthographic_camera_is_for_stages(ours):
    shot = kinds()["left"]
    assert ours.pipeline.at_once(replace(shot, camera=replace(shot.camera, is_orthographic=True))) is None


@pytest.mark.parametrize("kind", ["left", "past the border"])
def test_the_opacity_along_rays_is_the_cpus(renderers, kind):
    """Of the light from any depth about the hand, as much passes it."""
    shot = kinds()[kind]
    one, other = at_once(renderers[0], shot).profile, renderers[1].render(shot).profile
    depth = np.linspace(other.t[other.t > 0].min(), other.t.max(), 50)[None]
    assert one.row.shape == other.row.shape
    assert np.array_equal(one.row < 0, other.row < 0)
    passed = [
        profile.transmittance(profile.row.ravel(), np.repeat(depth, profile.row.size, 0)) for profile in (one, other)
    ]
    assert (passed[0] < 0.5).mean() > 0.02
    assert (np.abs(passed[0] - passed[1]) > 0.01).mean() < FLIPPED_OF_LEFT


def test_two_hands_before_each_other_are_composed_as_the_cpus(renderers):
    left = kinds()["left"]
    aside = replace(kinds()["right"], vertices=kinds()["right"].vertices + 0.03 * np.array([1.0, 0.3, 0]))
    pairs = []
    for render, renderer in ((at_once, renderers[0]), (Renderer.render, renderers[1])):
        pairs.append(joined(visible_parts([render(renderer, shot) for shot in (left, aside)])))
    assert pairs[0].alpha.sum() > 1.05 * at_once(renderers[0], left).alpha.sum()
    assert_same_frame(*pairs)


BORDERED = {"decoder_inputs", "image0", "image1"}
"""The columns by which inputs are padded, and the border of images, are zeros from the beginning."""


def test_poisoned_buffers_change_no_frame(ours):
    clean = at_once(ours, kinds()["left"])
    poison(buffers_of(ours), BORDERED)
    again = at_once(ours, kinds()["left"])
    for name in ("rgb", "alpha", "depth"):
        assert np.array_equal(getattr(again, name), getattr(clean, name))


def test_another_frame_through_the_same_buffers_is_as_alone(ours, avatar, hand, device):
    shot = kinds()["left"]
    other = replace(shot, vertices=shot.vertices + np.array([0.004, 0, 0.003]))
    at_once(ours, shot)
    alone = at_once(warp_renderer(avatar, hand, device), other)
    assert np.array_equal(at_once(ours, other).rgb, alone.rgb)
    assert not np.array_equal(alone.rgb, at_once(ours, shot).rgb)


def test_launches_of_a_frame(ours, monkeypatch):
    at_once(ours, kinds()["left"])
    buffers = buffers_of(ours)
    assert 20 < len(buffers.sequence.kernels) <= MOST_LAUNCHES, Counter(buffers.sequence.kernels)
    for name in ("synchronize", "synchronize_device", "synchronize_stream"):
        monkeypatch.setattr(wp, name, lambda *_: pytest.fail("the host waits"))
    buffers.sequence.run()
    graph = buffers.sequence.recorded()
    monkeypatch.undo()
    plain = at_once(ours, kinds()["left"])
    monkeypatch.setattr(buffers.sequence, "run", lambda: wp.capture_launch(graph))
    assert np.array_equal(at_once(ours, kinds()["left"]).rgb, plain.rgb)


def test_a_list_that_overflows_is_said_and_the_stages_take_over(avatar, hand, device, expected, monkeypatch, caplog):
    monkeypatch.setattr(baked_frame, "CAPACITY", 1)
    with caplog.at_level(logging.WARNING):
        frame = warp_renderer(avatar, hand, device).render(kinds()["left"])
    assert "fewer edges or layers" in caplog.text
    assert_same_frame(frame, expected)
