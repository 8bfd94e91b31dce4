"""LISA as re-implemented: size, blending, a sphere's disc, capsules on the hand, and a short fit."""

import numpy as np
import torch
from livehand.backend.evaluation.shot_renderer import ShotRenderer
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.posed_bones import bone_frames
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.research.baselines.lisa import (
    LISA,
    LisaField,
    blended,
    capsule_distance,
    capsules,
    laplace_density,
)
from livehand.backend.research.baselines.pixel_rays import composite_steps


def test_the_networks_have_the_proposed_size(hand, parameters):
    field = LisaField(*capsules(hand))
    assert parameters(field.shape) + parameters(field.colour) == 518_224
    assert parameters(field) == 518_225  # and b


def test_equal_bones_blend_to_one():
    distance, colour, logit = torch.randn(5, 1), torch.rand(5, 1, 3), torch.randn(5, 16)
    found = blended(distance.expand(5, 16), colour.expand(5, 16, 3), logit)
    torch.testing.assert_close(found[0], distance[:, 0])
    torch.testing.assert_close(found[1], colour[:, 0])


def test_one_heavy_bone_decides():
    logit = torch.zeros(4, 16)
    logit[:, 3] = 50
    distance, colour = torch.randn(4, 16), torch.rand(4, 16, 3)
    found = blended(distance, colour, logit)
    torch.testing.assert_close(found[0], distance[:, 3])
    torch.testing.assert_close(found[1], colour[:, 3])


def test_the_density_of_a_distance():
    b = torch.tensor(0.5)
    found = laplace_density(torch.tensor([-20.0, 0.0, 20.0, 0.5]), b)
    torch.testing.assert_close(found, torch.tensor([2.0, 1.0, 0.0, np.exp(-1)], dtype=torch.float32), atol=1e-6, rtol=0)


def test_a_spheres_distance_renders_its_disc():
    """Orthographic rays over a sphere of 60 mm; of a smaller one the density's edge of 0.05 mm is a larger share."""
    side, samples, radius_mm = 64, 400, 60.0
    y, x = torch.meshgrid(*[(torch.arange(side) + 0.5) / side * 180 - 90] * 2, indexing="ij")
    t = (torch.arange(samples) + 0.5) / samples * 180 - 90
    points = torch.stack(torch.broadcast_tensors(x.flatten()[:, None], y.flatten()[:, None], t), -1)
    density = laplace_density(points.norm(dim=-1) - radius_mm, torch.tensor(0.05))
    steps = torch.full((side**2, samples), 180 / samples)
    _, alpha, _ = composite_steps(density, torch.ones(side**2, samples, 1), steps)
    disc = x.flatten() ** 2 + y.flatten() ** 2 < radius_mm**2
    found = alpha > 0.5
    assert (found & disc).sum() / (found | disc).sum() > 0.99


def test_capsules_lie_in_the_fingers(hand, painted_capture):
    """The surface is near the nearest capsule's, in every pose."""
    for pose in (HandPose.rest(), painted_capture.poses[0]):
        vertices = torch.as_tensor(posed_vertices(hand, pose), dtype=torch.float32)
        frames = torch.as_tensor(bone_frames(hand, pose), dtype=torch.float32)
        spots = torch.einsum("vki,kij->vkj", vertices[:, None] - frames[:, :3, 3], frames[:, :3, :3])
        nearest = capsule_distance(1000 * spots, *capsules(hand)).amin(1)
        fingers = torch.as_tensor(hand.lbs_weights[:, 1:].sum(1) > 0.9)
        assert nearest[fingers].abs().median() < 2.5
        assert nearest[fingers].abs().max() < 9


def test_a_short_fit_renders(painted_capture, hand, machine, two_steps, cpu, tmp_path):
    assert LISA.fit(painted_capture, hand, two_steps, tmp_path, machine).steps == 2
    renderer = LISA.load(tmp_path, hand, cpu)
    assert isinstance(renderer, ShotRenderer)
    pose, view = painted_capture.poses[0], painted_capture.views[3]
    frame = renderer.render(Shot(pose, posed_vertices(hand, pose), view.camera))
    truth = painted_capture.read_image(view)[..., 3] > 0.5
    found = frame.alpha > 0.5
    assert (found & truth).sum() / (found | truth).sum() > 0.5  # of capsules
