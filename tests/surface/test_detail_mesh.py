"""The posed fine surface against the surface of captures, and its view against areas that are known; both backends."""

from math import pi

import numpy as np
import pytest
import torch
import trimesh
from livehand.backend.compute.cpu.backend import NumbaBackend
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.field.rays import HandInView, camera_tensors
from livehand.backend.geometry.loop import split_corners
from livehand.backend.geometry.mesh import posed_mesh
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.lbs import skin_motion
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE, MIRROR_POINT
from livehand.backend.hand.topology import topology_of
from livehand.backend.records.camera import Camera
from livehand.backend.records.shot import HandPose
from livehand.backend.surface.detail_mesh import (
    MOST_EDGE_PX,
    SAMPLES,
    DetailMesh,
    DetailTemplate,
    LevelsOfDetail,
    detail_mesh,
    on_surface,
    skin_motion_of,
    spread,
)
from livehand.backend.surface.detail_surface import load_detail_surface
from livehand.backend.surface.edge_antialiasing import SPREAD, SurfaceBones

pytestmark = pytest.mark.slow

AT_REST = HandPose(np.zeros((16, 3)), np.zeros(10), np.zeros(3))
SIZE, ONE = (48, 40), torch.tensor(1.0)


@pytest.fixture(scope="module")
def surface(hand):
    return load_detail_surface(hand.sha256)


@pytest.fixture(scope="module")
def templates(hand, surface):
    return {side: DetailTemplate.of(surface, hand.for_side(side)) for side in ("right", "left")}


def pose_of(gesture, side="right", beta=0.0):
    theta = theta_of(GESTURES[gesture].angles_deg(), FingerAxes.of_default_hand(), np.array([0.3, -0.2, 0.4]))
    forearm, transl = np.array([0.1, -0.2, 0.3]), np.array([0.4, -0.1, 0.2])
    if side == "left":
        theta, forearm, transl = theta * MIRROR_AXIS_ANGLE, forearm * MIRROR_AXIS_ANGLE, transl * MIRROR_POINT
    return HandPose(theta, np.full(10, beta), transl, side, forearm)


def flat_skin(template, motion):
    return torch.zeros(len(template.offset_m)), torch.zeros(len(motion.rest)), torch.tensor(1.0)


def test_at_rest_it_is_the_subdivided_template_moved_by_the_offsets(backend, hand, templates):
    right = templates["right"]
    motion = skin_motion(right.skin, AT_REST)
    found = backend.detail_mesh(right, motion, *flat_skin(right, motion))
    expected = torch.as_tensor(hand.v_template, dtype=torch.float32)
    for level in right.levels:
        expected = level(expected)
    torch.testing.assert_close(found.vertices, expected + right.offset_m, atol=1e-6, rtol=0)
    torch.testing.assert_close(found.normals, right.normals, atol=1e-4, rtol=0)


def test_the_coarse_faces_have_their_corners_on_the_surface(templates):
    """Of the four that a face is cut into, each of the first three keeps one of its corners."""
    template = templates["right"]
    coarse, fine = template.coarse_faces, template.faces
    assert 4 * len(coarse) == len(fine)
    assert coarse.max() + 1 == len(template.levels[0].start) - 1
    for corner in range(3):
        of_corner = fine[corner * len(coarse) : (corner + 1) * len(coarse)]
        assert (of_corner == coarse[:, corner, None]).any(1).all()


def test_the_coarser_template_shows_every_vertex_where_the_finest_does(backend, hand, templates):
    finest, pose = templates["right"], pose_of("fist")
    coarser, motion = finest.coarser(), skin_motion(finest.skin, pose)
    count = len(coarser.offset_m)
    height_m = torch.linspace(0, 0.002, len(finest.offset_m))
    flex = torch.linspace(-1, 1, len(motion.rest))
    fine, coarse = (
        backend.detail_mesh(template, motion, height_m[: len(template.offset_m)], flex, ONE)
        for template in (finest, coarser)
    )
    torch.testing.assert_close(coarse.vertices, fine.vertices[:count], atol=1e-7, rtol=0)
    torch.testing.assert_close(coarse.flex, fine.flex[:count], atol=1e-6, rtol=0)
    # Normals are of larger faces: nearly the same but for creases.
    assert (coarse.normals * fine.normals[:count]).sum(1).median() > 0.999
    expected = torch.as_tensor(split_corners(hand.vt[hand.ft]), dtype=torch.float32)
    torch.testing.assert_close(coarse.corner_uv, expected, atol=1e-6, rtol=0)
    of_weights = SurfaceBones.of(finest.levels[0](finest.skin.lbs_weights), coarse.faces, finest.skin.parents)
    assert (coarse.bones.of_face == of_weights.of_face).float().mean() > 0.98


def test_only_small_pictures_show_the_coarser_one(hand, surface):
    """Beyond the distance from which half an edge of the mesh is a pixel of the rays; the nearest vertex decides."""
    topology, levels = topology_of(hand), LevelsOfDetail.of(surface, hand, "cpu")
    mesh = posed_mesh(topology, torch.as_tensor(hand.v_template, dtype=torch.float32))
    edge_m, focal_px = float(topology.edge_length_m) / 2, 200.0
    K = np.array([[focal_px, 0, 24.0], [0, focal_px, 20.0], [0, 0, 1.0]])
    for beyond, expected in ((0.99, levels.finest), (1.01, levels.coarser), (-1.0, levels.finest)):
        cam2world = np.eye(4)
        cam2world[2, 3] = hand.v_template[:, 2].min() - beyond * edge_m * focal_px / MOST_EDGE_PX
        camera = camera_tensors(Camera(K, cam2world, SIZE), "cpu")
        assert levels.visible_in(HandInView(mesh, topology, camera)) is expected


def test_a_field_follows_what_rises_far_and_stays_where_it_has_learnt_the_skin(hand, surface):
    """A hand of twice the template's size: metres of the template count."""
    finest, pose, topology = DetailTemplate.of(surface, hand), AT_REST, topology_of(hand)
    motion = skin_motion(finest.skin, pose)
    mesh = posed_mesh(topology, 2 * motion.vertices)
    heights_m = torch.linspace(-0.003, 0.003, len(mesh.vertices))
    raised = mesh.vertices + 2 * heights_m[:, None] * mesh.normals
    fine = DetailMesh(torch.cat([raised, raised[:5]]), *(torch.zeros(0),) * 4, mesh.scale, finest.bones, torch.zeros(0))
    hand_in_view = HandInView(mesh, topology, camera_tensors(Camera(np.eye(3), np.eye(4), SIZE), "cpu"))
    met = on_surface(hand_in_view, fine, torch.full((5,), 0.7))
    assert torch.equal(met.surface_depth, torch.full((5,), 0.7))
    assert torch.equal(met.mesh.normals, mesh.normals)
    moved_m = ((met.mesh.vertices - mesh.vertices) * mesh.normals).sum(1) / 2
    close, far = heights_m.abs() < 0.00049, heights_m.abs() > 0.00151
    torch.testing.assert_close(moved_m[close], torch.zeros_like(moved_m[close]), atol=1e-7, rtol=0)
    torch.testing.assert_close(moved_m[far], heights_m[far], atol=1e-6, rtol=0)
    assert (moved_m.diff() > -1e-7).all(), "no height jumps over another"


def test_heights_lie_along_the_normals_at_rest(backend, hand, templates):
    right = templates["right"]
    motion = skin_motion(right.skin, AT_REST)
    _, flex, scale = flat_skin(right, motion)
    height_m = torch.linspace(0, 0.002, len(right.offset_m))
    low, high = (backend.detail_mesh(right, motion, each, flex, scale) for each in (0 * height_m, height_m))
    torch.testing.assert_close(high.vertices - low.vertices, height_m[:, None] * right.normals, atol=1e-6, rtol=0)


@pytest.mark.parametrize("gesture", ["open", "fist"])
def test_it_follows_skinning_as_the_surface_of_captures_does(backend, hand, templates, gesture):
    """The slow way: weights, correctives and shape of every finer vertex, and its own transform."""
    right, pose = templates["right"], pose_of(gesture, beta=0.7)
    motion = skin_motion(right.skin, pose)
    found = backend.detail_mesh(right, motion, *flat_skin(right, motion))

    def finer(values):
        values = torch.as_tensor(values, dtype=torch.float32).reshape(len(hand.v_template), -1)
        for level in right.levels:
            values = level(values)
        return values

    skin_weights, rest = finer(hand.lbs_weights), finer(motion.rest) + right.offset_m
    # Transforms are linear in the weights, so joints' own follow from these.
    of_joints = torch.linalg.lstsq(
        torch.cat([torch.as_tensor(hand.lbs_weights), torch.as_tensor(hand.arm_weights)[:, None]], 1).double(),
        motion.transforms.flatten(1).double(),
    ).solution
    weights = torch.cat([skin_weights, finer(hand.arm_weights[:, None])], 1).double()
    transforms = (weights @ of_joints).reshape(-1, 3, 4).float()
    expected = (transforms[..., :3] @ rest[..., None])[..., 0] + transforms[..., 3]
    torch.testing.assert_close(found.vertices, expected, atol=1e-5, rtol=0)


def test_the_left_hand_is_the_mirror_image(backend, hand, templates):
    mirror = torch.as_tensor(MIRROR_POINT, dtype=torch.float32)
    found = {}
    for side in ("right", "left"):
        motion = skin_motion(templates[side].skin, pose_of("fist", side))
        height, flex, scale = flat_skin(templates[side], motion)
        found[side] = backend.detail_mesh(templates[side], motion, height + 0.001, flex, scale)
    torch.testing.assert_close(found["left"].vertices, found["right"].vertices * mirror, atol=1e-6, rtol=0)
    torch.testing.assert_close(found["left"].normals, found["right"].normals * mirror, atol=1e-4, rtol=0)


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_mesh_that_no_pose_explains_is_followed_by_its_own_surface(hand, templates, side):
    """Turned, moved and twice as large, it is the posed one turned, moved and twice as large, but for joints."""
    template = templates[side]
    topology = topology_of(hand.for_side(side), canonical_side="right")
    posed = skin_motion(template.skin, pose_of("open", side))
    turn = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(1))).Q
    turn = turn * torch.linalg.det(turn)
    vertices = 2 * posed.vertices @ turn.T + torch.tensor([0.1, 0.2, 0.3])
    mesh = posed_mesh(topology, vertices)
    moved = skin_motion_of(template, mesh, topology.frames)
    torch.testing.assert_close(moved.vertices, vertices, atol=1e-6, rtol=0)
    _, flex, scale = flat_skin(template, posed)
    height = torch.full((len(template.offset_m),), 0.001)
    expected = detail_mesh(template, posed, height, flex, scale).vertices
    found = detail_mesh(template, moved, height, flex, mesh.scale).vertices
    apart_mm = 1e3 * (found / 2 - (expected @ turn.T + torch.tensor([0.05, 0.1, 0.15]))).norm(dim=-1)
    assert apart_mm.median() < 0.05
    assert apart_mm.quantile(0.95) < 0.4


def camera():
    """Looks along -Z from 1 m; at Z = 0 a pixel is 10 mm wide, the middle lies at the image's."""
    cam2world = np.diag([1.0, -1, -1, 1])
    cam2world[2, 3] = 1
    return camera_tensors(
        Camera(np.array([[100.0, 0, SIZE[0] / 2], [0, 100, SIZE[1] / 2], [0, 0, 1]]), cam2world, SIZE), "cpu"
    )


def one_bone(faces):
    """Of a surface that follows one bone."""
    return SurfaceBones(torch.zeros(faces, dtype=torch.int8), torch.tensor([[False]]))


def square(left_px, right_px, top_px, bottom_px):
    """A square at Z = 0 whose sides lie there in the image."""
    x = (torch.tensor([left_px, right_px, right_px, left_px]) - SIZE[0] / 2) / 100
    y = (SIZE[1] / 2 - torch.tensor([bottom_px, bottom_px, top_px, top_px])) / 100
    vertices = torch.stack([x, y, torch.zeros(4)], 1)
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    up = torch.tensor([0.0, 0, 1]).expand(4, 3)
    return DetailMesh(vertices, up, faces, torch.zeros(2, 3, 2), torch.zeros(4), ONE, one_bone(2), faces)


def ball(radius_m):
    """A sphere of 20,480 faces about the origin."""
    mesh = trimesh.creation.icosphere(5, radius_m)
    vertices, faces = torch.as_tensor(mesh.vertices, dtype=torch.float32), torch.as_tensor(np.array(mesh.faces))
    return DetailMesh(
        vertices,
        vertices / radius_m,
        faces,
        torch.zeros(len(faces), 3, 2),
        torch.zeros(len(vertices)),
        ONE,
        one_bone(len(faces)),
        faces,
    )


@pytest.mark.parametrize("edge_px", [9.0, 9.25, 9.5, 9.8])
def test_a_straight_edge_covers_pixels_by_their_share(backend, edge_px):
    seen = backend.visible_surface(square(edge_px, 30.0, 5.0, 33.0), camera())
    row = seen.coverage.reshape(SIZE[1], SIZE[0])[20]
    share = (torch.arange(SIZE[0]) + 1 - edge_px).clamp(0, 1)[:20]
    expected = SPREAD[0] * (share.roll(1) + share.roll(-1)) + SPREAD[1] * share
    torch.testing.assert_close(row[2:18], expected[2:18], atol=0.5 / 16, rtol=0)
    assert row[15:25].eq(1).all()
    assert row[:7].eq(0).all()


def test_faces_and_depth_are_those_at_the_centres(backend):
    seen = backend.visible_surface(square(9.4, 30.0, 5.0, 33.0), camera())
    inside = torch.zeros(SIZE[1], SIZE[0], dtype=torch.bool)
    inside[5:33, 9:30] = True
    assert torch.equal((seen.face >= 0).reshape(SIZE[1], SIZE[0]), inside)
    torch.testing.assert_close(seen.depth[inside.flatten()], torch.ones(int(inside.sum())))
    depth = seen.depth.reshape(SIZE[1], SIZE[0])
    torch.testing.assert_close(depth[4:34, 8], torch.ones(30))  # the surface is seen beside their centres
    assert depth[5:33, 7].isinf().all()
    assert torch.equal(depth[3:35, 7:31].isfinite(), seen.coverage.reshape(SIZE[1], SIZE[0])[3:35, 7:31] > 0)


@pytest.mark.parametrize("backend", [ReferenceBackend, NumbaBackend])
def test_depths_of_an_orthographic_camera_are_linear_on_screen(backend):
    """Of a square that leans from Z = 0.4 to -0.4."""
    flat = square(8.0, 40.0, 5.0, 33.0)
    x = flat.vertices[:, 0]
    leaning = flat._replace(vertices=torch.stack([x, flat.vertices[:, 1], -2.5 * x], 1))
    seen = backend().visible_surface(leaning, camera()._replace(is_orthographic=True))
    at = seen.face >= 0
    column = torch.arange(SIZE[0]).repeat(SIZE[1])
    torch.testing.assert_close(seen.depth[at], (1 + 2.5 * (column + 0.5 - SIZE[0] / 2) / 100)[at])
    assert at.sum() == 28 * 32


def test_where_a_pixel_shows_the_surface_beside_its_centre_it_is_as_deep_as_what_is_nearest_around(backend):
    leaning = square(9.4, 30.0, 5.0, 33.0)
    leaning = leaning._replace(vertices=leaning.vertices * torch.linspace(1, 1.3, 4)[:, None])
    seen = backend.visible_surface(leaning, camera())
    depth = torch.where(seen.face >= 0, seen.depth, torch.inf).reshape(1, 1, SIZE[1], SIZE[0])
    lowest = -torch.nn.functional.max_pool2d(-depth, 3, 1, 1).flatten()
    beside = (seen.face < 0) & (seen.coverage > 0)
    assert beside.sum() > 40
    torch.testing.assert_close(seen.depth[beside], lowest[beside])


def test_a_ball_covers_the_area_of_its_outline(backend):
    """Its outline from 1 m is a circle of the radius r / sqrt(1 - r^2)."""
    seen = backend.visible_surface(ball(0.1), camera())
    radius_px = 100 * 0.1 / np.sqrt(1 - 0.1**2)
    assert seen.coverage.sum().item() == pytest.approx(pi * radius_px**2, rel=6e-3)  # of 16 samples
    nearest = seen.depth.min().item()
    assert nearest == pytest.approx(0.9, abs=1e-3)


def test_a_mesh_out_of_sight_covers_nothing(backend):
    far_left = square(-30.0, -5.0, 5.0, 33.0)
    seen = backend.visible_surface(far_left, camera())
    assert seen.coverage.eq(0).all()
    assert seen.face.eq(-1).all()
    turned_away = far_left._replace(faces=far_left.faces.flip(1), vertices=square(9.0, 30.0, 5.0, 33.0).vertices)
    assert backend.visible_surface(turned_away, camera()).coverage.eq(0).all()


def test_samples_stratify_both_axes():
    """Each 16th of a pixel's width and of its height has one."""
    for axis in (0, 1):
        assert sorted(int(16 * sample[axis]) for sample in SAMPLES) == list(range(16))


def test_spreading_keeps_the_total_within_the_image():
    coverage = torch.zeros(SIZE[1], SIZE[0])
    coverage[10:20, 12:30] = torch.rand(10, 18, generator=torch.Generator().manual_seed(0))
    found = spread(coverage.flatten(), SIZE)
    torch.testing.assert_close(found.sum(), coverage.sum())
    torch.testing.assert_close(spread(torch.ones(SIZE[0] * SIZE[1]), SIZE), torch.ones(SIZE[0] * SIZE[1]))


@pytest.mark.parametrize("side", ["right", "left"])
def test_both_backends_see_the_same_hand(backend_pair, fine_hand, view_from, side):
    mesh = fine_hand("fist", side)
    view = view_from(mesh, (0.2, -1, 0.4), size_px=(120, 110))
    ours, theirs = (each.visible_surface(mesh, view) for each in backend_pair)
    assert (ours.face == theirs.face).float().mean() > 0.999  # of two faces that share an edge
    torch.testing.assert_close(ours.depth, theirs.depth, atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(ours.coverage, theirs.coverage, atol=0.07, rtol=0)  # a sample on an edge
    assert (ours.coverage - theirs.coverage).abs().mean() < 1e-4
