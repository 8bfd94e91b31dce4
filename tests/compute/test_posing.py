"""A posed mesh by the kernels against `hand.lbs`, `geometry.mesh` and `geometry.local_rotation`."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.hand.lbs import SkinTensors
from livehand.backend.records.shot import HandPose


def poses(count, side):
    """Of all joints, shapes and places, and of a bent forearm; the first ones hardly turn anything."""
    random = np.random.default_rng(5)
    for turn in np.geomspace(1e-5, 2, count):
        theta, beta = turn * random.normal(size=(16, 3)), random.normal(size=10)
        yield HandPose(theta, beta, random.normal(size=3), side, turn * random.normal(size=3))


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_motion_of_the_skin_is_the_references(backend_pair, hand, side):
    model = hand.for_side(side)
    shaped = SkinTensors.of(replace(model, shapedirs=1e-3 * np.random.default_rng(3).normal(size=(1919, 3, 10))))
    for pose in poses(8, side):
        ours, theirs = (each.skin_motion(shaped, pose) for each in backend_pair)
        torch.testing.assert_close(ours.rest, theirs.rest, atol=2e-7, rtol=0)
        torch.testing.assert_close(ours.transforms, theirs.transforms, atol=4e-6, rtol=0)
        torch.testing.assert_close(ours.vertices, theirs.vertices, atol=2e-6, rtol=0)


def test_a_hand_at_rest_stays_where_it_is(backend, hand):
    skin = SkinTensors.of(hand)
    motion = backend.skin_motion(skin, HandPose.rest())
    assert torch.equal(motion.rest, skin.v_template)
    torch.testing.assert_close(motion.vertices, skin.v_template, atol=1e-7, rtol=0)
    skin.v_template[0, 0] += 1  # what is returned shares no memory with the model
    assert not torch.equal(motion.rest, skin.v_template)


@pytest.mark.parametrize("side", ["right", "left"])
def test_normals_scale_and_rotations_are_the_references(backend_pair, posed, side):
    hand = posed("fist", side)
    vertices, topology = 1.3 * hand.mesh.vertices, hand.topology
    ours, theirs = (each.posed_mesh(topology, vertices) for each in backend_pair)
    assert torch.equal(ours.vertices, vertices)
    torch.testing.assert_close(ours.normals, theirs.normals, atol=2e-5, rtol=0)  # 1e-5: of slivers
    torch.testing.assert_close(ours.scale, theirs.scale, atol=0, rtol=1e-6)
    of_theirs = theirs.vertices, theirs.normals, topology.frames
    ours, theirs = (each.local_rotations(*of_theirs) for each in backend_pair)
    torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=0)


def test_a_vertex_without_area_has_no_normal_and_no_rotation(backend, posed):
    topology = posed("open").topology
    flat = torch.zeros(len(posed("open").mesh.vertices), 3)
    ours = backend.posed_mesh(topology, flat)
    assert torch.equal(ours.normals, flat)
    assert torch.equal(backend.local_rotations(flat, ours.normals, topology.frames), torch.zeros(len(flat), 3, 3))
