"""What the host does for a frame at once, against the modules whose values it computes in less time."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.avatars.file import load_avatar
from livehand.backend.compute.cpu.backend import NumbaBackend
from livehand.backend.compute.gpu.backend import WarpBackend
from livehand.backend.compute.gpu.frame_parameters import camera_axes, focal_of
from livehand.backend.compute.gpu.frame_views import lamp_views
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.field.conditions import joint_pose
from livehand.backend.field.rays import camera_tensors
from livehand.backend.hand.topology import topology_of
from livehand.backend.image.crop import crop_of
from livehand.backend.light.lamp_samples import LampSamples
from livehand.backend.light.shadow_maps import Bounds
from livehand.backend.render.lit_shots import LitShots
from livehand.backend.research.benchmark.motion import MovingHand

from .conftest import AREAS, POINT, SPOT, SUN

ROUNDED = 1e-5
"""Of the largest value: sums over up to 6,000 numbers in single precision, in another order."""


@pytest.fixture(scope="module")
def several(hand):
    """Shots from near and far, whole, past the border, with parts behind the camera, and out of view."""
    motion = MovingHand(hand, (167, 256))
    shots = [motion.shot(frame) for frame in motion.frames(24)]
    first = shots[0]
    shots += [replace(first, camera=first.camera.cropped(*at, (90, 70))) for at in ((40, 90), (-30, 10), (400, 0))]
    within = first.camera.cam2world.copy()
    within[:3, 3] = first.vertices.mean(0)
    for cam2world in (within, within * np.array([1, 1, 1, 1e3])):
        shots.append(replace(first, camera=replace(first.camera, cam2world=cam2world)))
    shots.append(replace(first, camera=replace(first.camera, is_orthographic=True)))
    return shots


@pytest.mark.parametrize("backend", [NumbaBackend(), ReferenceBackend()])
def test_a_hands_extent_is_that_of_its_mesh_and_gives_its_crop(several, hand, backend):
    topology, sampler = topology_of(hand, "cpu", "right"), load_avatar().config.sampler
    cropped = 0
    for shot in several:
        vertices = torch.as_tensor(shot.vertices, dtype=torch.float32)
        mesh = ReferenceBackend().posed_mesh(topology, vertices)
        found = backend.hand_extent(topology, vertices, camera_tensors(shot.camera, "cpu"), sampler.shell_m)
        bounds = Bounds.of(mesh)
        assert found.scale == pytest.approx(float(mesh.scale), rel=ROUNDED)
        np.testing.assert_allclose(found.centre, bounds.centre, atol=ROUNDED * np.abs(shot.vertices).max())
        assert found.radius == pytest.approx(float(bounds.radius), rel=ROUNDED)
        for scale in (1, 2):
            expected = crop_of(mesh, shot.camera, sampler, scale)
            assert found.crop(shot.camera.size_px, scale) == expected
            cropped += expected is not None
    assert 2 * 24 <= cropped < 2 * len(several)


def test_cameras_axes_are_by_the_inverse_of_their_matrix(several):
    for shot in several:
        tensors = camera_tensors(shot.camera, "cpu")
        K, world2cam = tensors.K.double().numpy(), tensors.world2cam.double().numpy()
        K[0, 1] = 0.3
        turn = world2cam[:3, :3]
        expected = [-turn.T @ world2cam[:3, 3], *(turn.T @ np.linalg.inv(K)).T]
        np.testing.assert_allclose(camera_axes(K, world2cam), expected, atol=1e-9)
        assert focal_of(tensors) == pytest.approx(float(tensors.focal_px))


@pytest.mark.parametrize("lamps", [(), (SUN,), (*AREAS, SUN, POINT, SPOT)])
def test_views_of_lamps_are_those_of_their_samples(lamps):
    bounds = Bounds(torch.tensor([0.01, -0.2, 0.3]), torch.tensor(0.12))
    samples = LampSamples.of(lamps, bounds)
    frames, distance = lamp_views(samples, bounds)
    expected = samples.views(bounds)
    np.testing.assert_allclose(frames, expected.frames, atol=2e-6)
    np.testing.assert_allclose(distance, expected.distance, rtol=ROUNDED)


def test_what_is_listed_of_vertices_rises_as_on_the_avatars_surface(several, hand):
    shots = LitShots.of(load_avatar(), hand, WarpBackend("cpu"))
    raised, veins_mm = shots.surface.surface.raised, 0.4
    listed = raised.parts_of_vertices(veins_mm)
    rows = np.repeat(np.arange(len(listed.resting_mm)), np.diff(listed.start))
    for shot in several[:8]:
        shares = raised.shares(shot.pose.theta, shot.pose.forearm)
        risen = np.bincount(rows, shares[listed.part] * listed.height_mm, len(listed.resting_mm))
        expected = raised.height_mm(shot.pose.theta, veins_mm, shot.pose.forearm)
        assert len(shares) == listed.parts
        np.testing.assert_allclose(listed.resting_mm + risen, expected, atol=1e-5)
    assert np.ptp(expected) > 0.5


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_fields_pose_is_that_of_its_conditions(several, hand, side):
    shots = LitShots.of(load_avatar(), hand, WarpBackend("cpu"))
    pose = replace(several[5].pose, side=side)
    theta = pose.theta * (1 if side == "right" else np.array([1, -1, -1]))
    expected = joint_pose(torch.as_tensor(theta, dtype=torch.float32), shots.skinning.parents)
    np.testing.assert_allclose(shots.joint_pose(pose), expected, atol=1e-6)
    assert np.abs(pose.theta[0]).max() > 0
