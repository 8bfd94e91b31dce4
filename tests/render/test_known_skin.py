"""Which avatars show a skin that is known, and where its surface lies."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.avatars.file import load_avatar
from livehand.backend.avatars.library import avatar_path
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.geometry.mesh import posed_mesh
from livehand.backend.hand.lbs import posed_vertices, skin_motion
from livehand.backend.hand.topology import topology_of
from livehand.backend.records.shot import HandPose
from livehand.backend.render.known_skin import skin_of
from livehand.backend.surface.fine_mesh import FineTemplate, fine_mesh

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def avatar():
    return load_avatar()


def of_person(avatar, capture):
    return skin_of(replace(avatar, provenance={"capture": capture}), CPU)


def test_the_avatars_that_ship_have_their_persons_detail():
    tables = {name: skin_of(load_avatar(avatar_path(name)), CPU).maps.table for name in ("light", "deep")}
    assert not torch.equal(tables["light"], tables["deep"])


@pytest.mark.parametrize(
    "capture",
    [
        None,
        {"made_by": "livehand import", "plan": {"person": {"melanin": 0.0, "folds": 1.0, "veins_mm": 0.2}}},
        {"made_by": "livehand capture", "plan": {"tone": "light"}},
        {
            "made_by": "livehand capture",
            "plan": {"person": {"melanin": 0.0, "folds": 1.0, "veins_mm": 0.2}},
            "look_sha256": None,
        },
        {"made_by": "livehand capture", "plan": {"person": {"melanin": "a", "folds": 1.0, "veins_mm": 0.2}}},
        {"made_by": "livehand capture", "plan": {"person": {"melanin": float("nan"), "folds": 1.0, "veins_mm": 0.2}}},
        {
            "made_by": "livehand capture",
            "plan": {"person": {"melanin": 0.0, "folds": 1.0, "veins_mm": 0.2, "nail_polish": [1, 0, 0]}},
        },
    ],
)
def test_another_skin_has_none(avatar, capture):
    assert of_person(avatar, capture) is None


def test_an_avatar_of_another_hand_has_none(avatar):
    assert skin_of(replace(avatar, hand_sha256="0" * 64), CPU) is None


def test_deeper_folds_are_steeper(avatar):
    young, old = (
        of_person(
            avatar,
            {"made_by": "livehand capture", "plan": {"person": {"melanin": 0.0, "folds": folds, "veins_mm": 0.0}}},
        ).maps
        for folds in (0.7, 1.4)
    )
    slopes = [maps.table[:, 2:6].float().abs().mean().item() for maps in (young, old)]
    assert slopes[1] == pytest.approx(2 * slopes[0], rel=0.1)
    assert np.isfinite(slopes).all()


def test_the_surface_follows_the_pose_and_else_the_mesh(avatar, hand):
    """That of the pose, to the bit, where the mesh is the pose's; sculpted by 2 mm, it is raised by about as much."""
    known = skin_of(avatar, CPU)
    topology, template = topology_of(hand), FineTemplate.of(known.surface, hand)
    pose = HandPose(np.zeros((16, 3)), np.zeros(10), np.array([0.1, 0.2, 0.3]))
    mesh = posed_mesh(topology, torch.as_tensor(posed_vertices(hand, pose), dtype=torch.float32))
    of_pose = known.posed(template, pose, mesh, topology.frames, ReferenceBackend())
    height = torch.as_tensor(1e-3 * known.surface.raised.height_mm(pose.theta, known.veins_mm), dtype=torch.float32)
    flex = torch.as_tensor(known.bend.flex(pose.theta), dtype=torch.float32)
    expected = fine_mesh(template, skin_motion(template.skin, pose), height, flex, mesh.scale)
    assert torch.equal(of_pose.vertices, expected.vertices)
    sculpted = mesh._replace(vertices=mesh.vertices + 0.002 * mesh.normals)
    raised = known.posed(template, pose, sculpted, topology.frames, ReferenceBackend()).vertices - of_pose.vertices
    along_mm = 1e3 * (raised * of_pose.normals).sum(-1)
    assert 1.5 < along_mm.median() < 2.1
