"""The fields of the paper's ablations: sizes as published, what they ask for, and sparse as dense."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.avatars.avatar import AvatarConfig, build_field, new_avatar
from livehand.backend.avatars.file import load_avatar, save_avatar
from livehand.backend.field.conditions import FieldInputs, SamplePoints
from livehand.backend.field.field import CHANNELS, FieldConfig
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.field.volume import Steps
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import Shot
from livehand.backend.render.renderer import Renderer

pytestmark = pytest.mark.slow

PAPER_SUPERRES = 320_906
XYZ, BONES = FieldConfig(kind="xyz"), FieldConfig(kind="bones", pose=False)
RAYS, SAMPLES = 6, 3


def parameters(network):
    return sum(parameter.numel() for parameter in network.parameters())


def test_sizes_are_those_of_the_papers_table():
    """Together with the published super-resolution: 0.95 M and 1.14 M."""
    assert parameters(build_field(XYZ)) == 624_161
    assert parameters(build_field(XYZ)) + PAPER_SUPERRES == 945_067
    assert parameters(build_field(replace(XYZ, pose=False))) == 624_161 - 2 * 48 * 256
    assert parameters(build_field(BONES)) == 16 * 51_009
    assert parameters(build_field(BONES)) + PAPER_SUPERRES == 1_137_050
    assert parameters(build_field(replace(BONES, pose=True))) == 16 * (51_009 + 48 * 96)


def inputs_of(seed=0):
    count, generator = RAYS * SAMPLES, torch.Generator().manual_seed(seed)

    def rand(*shape):
        return torch.rand(*shape, generator=generator)

    weights = rand(count, 16) * (rand(count, 16) > 0.8)
    weights[:, 0] += 0.1
    points = SamplePoints(rand(count, 3), 0.05 * rand(count, 16, 3), weights / weights.sum(1, keepdim=True))
    empty = {name: torch.empty(0) for name in FieldInputs._fields}
    view = torch.nn.functional.normalize(rand(RAYS, 3) - 0.5, dim=-1)
    return FieldInputs(**(empty | {"view": view, "theta": rand(48), "place": points}))


def ask(field, inputs):
    t = torch.linspace(0.4, 0.41, SAMPLES).expand(RAYS, -1)
    return field(inputs, Steps(t, torch.full((RAYS,), 0.5), torch.zeros(RAYS, dtype=torch.bool)))


@pytest.mark.parametrize("kind", [XYZ, BONES, replace(BONES, pose=True)], ids=["xyz", "bones", "bones with pose"])
def test_a_field_hears_places_and_view_and_the_pose_if_it_has_one(kind):
    torch.manual_seed(0)
    field, inputs = build_field(kind), inputs_of()
    first = ask(field, inputs)
    assert first.channels.shape == (RAYS, CHANNELS)
    moved = inputs.place._replace(world=inputs.place.world + 0.01, in_bones=inputs.place.in_bones + 0.01)
    assert not torch.equal(ask(field, inputs._replace(place=moved)).alpha, first.alpha)
    assert not torch.equal(ask(field, inputs._replace(view=-inputs.view)).channels, first.channels)
    assert torch.equal(ask(field, inputs._replace(view=-inputs.view)).alpha, first.alpha)
    has_moved = not torch.equal(ask(field, inputs._replace(theta=inputs.theta + 1)).alpha, first.alpha)
    assert has_moved == kind.pose


def test_asking_only_bones_with_weight_is_exact():
    torch.manual_seed(1)
    field, inputs = build_field(BONES), inputs_of()
    assert (inputs.place.bone_weights == 0).float().mean() > 0.5
    calls = []
    for bone in field.bones:
        bone.register_forward_hook(lambda module, given, out: calls.append(len(out)))
    sparse, asked = ask(field, inputs), sum(calls)
    field.is_dense = True
    calls.clear()
    dense = ask(field, inputs)
    assert asked == int((inputs.place.bone_weights > 0).sum()) < sum(calls) == 16 * RAYS * SAMPLES
    for one, other in zip(sparse, dense, strict=True):
        torch.testing.assert_close(one, other)
    sparse.channels.sum().backward()
    assert all(p.grad is None or p.grad.isfinite().all() for p in field.parameters())


def test_bones_without_frames_are_refused():
    field, inputs = build_field(BONES), inputs_of()
    without = inputs.place._replace(in_bones=torch.zeros(RAYS * SAMPLES, 0, 3))
    with pytest.raises(LiveHandError, match="without --refine"):
        ask(field, inputs._replace(place=without))


def avatar_of(hand, field, superres="paper"):
    config = AvatarConfig(field, SuperResConfig(kind=superres), SamplerConfig(4, 0.005))
    return new_avatar("ablation", hand.name, hand.sha256, config)


@pytest.fixture
def shot(painted_capture, hand):
    pose, view = painted_capture.poses[0], painted_capture.views[0]
    return Shot(pose, posed_vertices(hand, pose), view.camera)


@pytest.mark.parametrize("kind", [XYZ, BONES, FieldConfig(kind="paper", pose=False)], ids=["xyz", "bones", "poseless"])
def test_an_ablated_avatar_is_saved_and_rendered(kind, hand, shot, tmp_path):
    save_avatar(avatar_of(hand, kind), tmp_path / "a.safetensors")
    back = load_avatar(tmp_path / "a.safetensors")
    assert back.config.field == kind
    frame = Renderer(back, hand, "cpu").render(shot)
    assert frame.alpha.max() > 0.5
    assert np.isfinite(frame.rgb).all()


def test_bones_follow_the_hand_and_refuse_a_mesh_off_its_pose(hand, shot):
    """Hand and camera moved together give the same picture, up to what the world's light would change: nothing."""
    renderer = Renderer(avatar_of(hand, BONES), hand, "cpu")
    shift = np.array([0.3, -0.2, 0.1])
    cam2world = shot.camera.cam2world.copy()
    cam2world[:3, 3] += shift
    pose = replace(shot.pose, transl=shot.pose.transl + shift)
    moved = Shot(pose, shot.vertices + shift, replace(shot.camera, cam2world=cam2world))
    np.testing.assert_allclose(renderer.render(moved).rgb, renderer.render(shot).rgb, atol=2e-3)
    with pytest.raises(LiveHandError, match="mm off"):
        renderer.render(replace(shot, vertices=shot.vertices + 0.005))


@pytest.mark.parametrize("superres", ["bilinear", "none"])
def test_without_learnt_superresolution(hand, shot, superres):
    avatar = avatar_of(hand, FieldConfig(kind="paper"), superres)
    assert parameters(avatar.superres) == 0
    frame = Renderer(avatar, hand, "cpu").render(shot)
    learnt = Renderer(avatar_of(hand, FieldConfig(kind="paper")), hand, "cpu").render(shot)
    found, expected = frame.alpha > 0.5, learnt.alpha > 0.5
    assert (found & expected).sum() / (found | expected).sum() > 0.75
    assert (frame.profile is None) == (superres == "none")
    if superres == "bilinear":  # the published network starts as that
        np.testing.assert_allclose(frame.rgb, learnt.rgb, atol=1e-5)
