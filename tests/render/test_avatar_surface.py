"""The surface of an avatar, ready to pose; and that nothing but the avatar's surface decides whether it has one."""

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from livehand.backend import render
from livehand.backend.avatars.file import load_avatar
from livehand.backend.avatars.library import avatar_path
from livehand.backend.capture.person import Person
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.geometry.mesh import posed_mesh
from livehand.backend.hand.lbs import posed_vertices, skin_motion
from livehand.backend.hand.topology import topology_of
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose
from livehand.backend.render.avatar_surface import avatar_surface_of, hairs_on
from livehand.backend.surface.base_surface import base_arrays, surface_of_person
from livehand.backend.surface.detail_mesh import DetailTemplate, detail_mesh

CPU = torch.device("cpu")
# Goes with Rough Relighting, which asks for the light that is baked into an avatar.
STILL_READS_PROVENANCE = {"rough_light.py"}


@pytest.fixture(scope="module")
def avatar():
    return load_avatar()


def of_person(avatar, hand, **numbers):
    return avatar_surface_of(replace(avatar, surface=surface_of_person(Person(**numbers), hand.sha256)), CPU)


def reads_of_provenance(source):
    return [
        node.lineno
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Attribute | ast.Constant)
        and "provenance" in (getattr(node, "attr", None), getattr(node, "value", None))
    ]


def test_no_provenance_decides_rendering():
    files = {path.name: path.read_text(encoding="utf-8") for path in Path(render.__file__).parent.glob("**/*.py")}
    assert len(files) > 20
    assert {name for name, source in files.items() if reads_of_provenance(source)} <= STILL_READS_PROVENANCE


def test_a_read_of_provenance_is_found():
    assert reads_of_provenance("x = avatar.provenance.get('capture')") == [1]
    assert reads_of_provenance("x = getattr(avatar, 'provenance')") == [1]


@pytest.mark.slow
def test_known_is_what_has_a_surface(avatar):
    assert avatar_surface_of(replace(avatar, provenance={}), CPU) is not None
    assert avatar_surface_of(replace(avatar, surface=None), CPU) is None


@pytest.mark.slow
def test_the_avatars_that_ship_have_their_persons_detail():
    tables = {name: avatar_surface_of(load_avatar(avatar_path(name)), CPU).maps.table for name in ("light", "deep")}
    assert not torch.equal(tables["light"], tables["deep"])


@pytest.mark.slow
def test_deeper_folds_are_steeper(avatar, hand):
    young, old = (of_person(avatar, hand, folds=folds, veins_mm=0.0).maps for folds in (0.7, 1.4))
    slopes = [maps.table[:, 2:6].float().abs().mean().item() for maps in (young, old)]
    assert slopes[1] == pytest.approx(2 * slopes[0], rel=0.1)
    assert np.isfinite(slopes).all()


@pytest.mark.slow
def test_maps_offsets_and_hairs_are_those_of_the_avatars_file(avatar, hand):
    """An avatar's own arrays are rendered, and not the base's."""
    base = base_arrays()
    own = {
        "offset": base["offset"] + np.int16(100),
        "nail": np.full_like(base["nail"], 100),
        "hair/share": np.where(np.arange(4) == 1, base["hair/share"], np.float32(0)),
    }
    skin, known = (
        avatar_surface_of(replace(avatar, surface=replace(avatar.surface, arrays=own)), CPU),
        avatar_surface_of(avatar, CPU),
    )
    assert (skin.surface.offset_m - known.surface.offset_m) == pytest.approx(1e-4, abs=1e-6)
    assert (skin.maps.table[:, 9] == 100).all()
    assert torch.equal(skin.maps.table[:, :2], known.maps.table[:, :2])
    template = DetailTemplate.of(known.surface, hand)
    of_back, of_all = (len(hairs_on(one, template).corners) for one in (skin, known))
    assert 0 < of_back < 0.3 * of_all


@pytest.mark.slow
def test_marks_of_the_left_hand_are_not_on_the_right_one(avatar):
    steps, marks = np.zeros((64, 64, 3), np.int8), np.zeros((64, 64), np.uint8)
    steps[20:24, 10:30], marks[20:24, 10:30] = -90, 255
    arrays = {**avatar.surface.arrays, "albedo/ratio": steps, "marks/left": marks}
    skin = avatar_surface_of(replace(avatar, surface=replace(avatar.surface, arrays=arrays)), CPU)
    at = 22 * 64 + 20
    assert skin.maps_of("left").ratio.table[at].tolist() == [-90, -90, -90]
    assert skin.maps_of("right").ratio.table[at].tolist() == [0, 0, 0]
    assert skin.maps_of("left").table is skin.maps_of("right").table


@pytest.mark.slow
def test_a_surface_that_does_not_fit_the_mesh_is_refused(avatar, hand):
    surface = avatar_surface_of(avatar, CPU).surface
    with pytest.raises(LiveHandError, match=r"the surface must have the 30674 vertices of .* got 30673"):
        DetailTemplate.of(replace(surface, offset_m=surface.offset_m[:-1]), hand)


@pytest.mark.slow
def test_the_surface_follows_the_pose_and_else_the_mesh(avatar, hand):
    """That of the pose, to the bit, where the mesh is the pose's; sculpted by 2 mm, it is raised by about as much."""
    known = avatar_surface_of(avatar, CPU)
    topology, template = topology_of(hand), DetailTemplate.of(known.surface, hand)
    pose = HandPose(np.zeros((16, 3)), np.zeros(10), np.array([0.1, 0.2, 0.3]))
    mesh = posed_mesh(topology, torch.as_tensor(posed_vertices(hand, pose), dtype=torch.float32))
    of_pose = known.posed(template, pose, mesh, topology.frames, ReferenceBackend())
    height = torch.as_tensor(1e-3 * known.surface.raised.height_mm(pose.theta, known.veins_mm), dtype=torch.float32)
    flex = torch.as_tensor(known.bend.flex(pose.theta), dtype=torch.float32)
    expected = detail_mesh(template, skin_motion(template.skin, pose), height, flex, mesh.scale)
    assert torch.equal(of_pose.vertices, expected.vertices)
    sculpted = mesh._replace(vertices=mesh.vertices + 0.002 * mesh.normals)
    raised = known.posed(template, pose, sculpted, topology.frames, ReferenceBackend()).vertices - of_pose.vertices
    along_mm = 1e3 * (raised * of_pose.normals).sum(-1)
    assert 1.5 < along_mm.median() < 2.1
