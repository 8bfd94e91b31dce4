"""Outlines lie on the edge of what is covered, and pairs say how far a mesh is off."""

import numpy as np
import pytest
import torch
from livehand.backend.geometry.loop import loop_step
from livehand.backend.person.rig.outlines import (
    NONE,
    OutlinedGeometry,
    OutlineTree,
    PairedViews,
    covered_pixels,
    outline_of,
    outline_pairs,
    tells_edges,
)
from livehand.backend.person.rig.rig_cameras import RigCameras
from livehand.backend.surface.detail_mesh import SubdivisionLevel
from scipy.sparse import csr_array


def disc(radius=30.0, size=100):
    rows, columns = np.mgrid[:size, :size] + 0.5
    return (rows - size / 2) ** 2 + (columns - size / 2) ** 2 < radius**2


def test_the_outline_of_a_disc_is_its_circle_with_normals_to_the_middle():
    outline = outline_of(disc())
    away = outline.px - 50
    assert np.linalg.norm(away, axis=1) == pytest.approx(np.full(len(away), 29.5), abs=1.0)
    inward = -away / np.linalg.norm(away, axis=1, keepdims=True)
    assert (outline.normal * inward).sum(1).min() > 0.98
    assert np.median(np.linalg.norm(outline.rim_px - 50, axis=1)) == pytest.approx(30, abs=0.1)
    assert len(outline.px) == 236  # every pixel of the disc that touches one outside it, by a side or a corner


def test_the_picture_s_own_edge_is_no_outline():
    region = np.zeros((60, 60), bool)
    region[:, :30] = True
    outline = outline_of(region)
    assert set(outline.column.tolist()) == {29}
    assert outline_of(np.ones((60, 60), bool)).px.shape == (0, 2)


def test_edges_before_a_bright_ground_are_not_told():
    is_hand = disc()
    grey = np.where(is_hand, 240, np.where(np.arange(100) < 50, 255, 60)).astype(np.uint8)
    rgb = np.stack([grey] * 3, -1)
    tells = tells_edges(rgb, ~is_hand)
    outline = outline_of(is_hand)
    is_told = tells[outline.row, outline.column]
    assert not is_told[outline.column < 45].any()
    assert is_told[outline.column > 55].all()
    assert tells[~is_hand & (np.arange(100) > 60)].all()
    assert tells[is_hand & (np.hypot(*np.indices((100, 100)) - 50) < 15)].all()  # no ground near by


def test_the_nearest_pixel_is_of_the_same_direction():
    tree = OutlineTree(outline_of(disc()), 1.0)
    smaller = outline_of(disc(25.0))
    distance, px, normal = tree.nearest(smaller)
    assert np.median(distance) == pytest.approx(5, abs=0.7)
    assert (normal * smaller.normal).sum(1).min() > 0.95
    assert np.abs(px - smaller.px).max() < 7
    empty = OutlineTree(outline_of(np.zeros((9, 9), bool)), 1.0)
    assert np.isinf(empty.nearest(smaller)[0]).all()


def test_pixels_are_covered_where_the_camera_sees_vertices(made_rig):
    camera, hands = made_rig.cameras[1], made_rig.hands
    covered = covered_pixels(made_rig.vertices, hands.faces, camera)
    px, depth = camera.project(made_rig.vertices)
    is_inside = ((px > 1) & (px < np.array(camera.size_px) - 1)).all(1)
    column, row = px[is_inside].astype(int).T
    is_covered = covered.face[row, column] != NONE
    assert is_covered.mean() > 0.93  # but those on the very outline
    assert (covered.depth[row, column] <= depth[is_inside] + 3e-3)[is_covered].mean() > 0.95
    assert covered.face.max() < len(hands.faces)
    assert (covered.depth[covered.face == NONE] == 1e3).all()


def test_pairs_measure_by_how_much_a_picture_is_moved(made_rig):
    hands, camera, scale = made_rig.hands, made_rig.cameras[1], 0.9
    skin = covered_pixels(made_rig.vertices, hands.faces, camera).face != NONE
    moved = np.roll(skin, 3, 1)
    surface = OutlinedGeometry.of_meshes(made_rig.vertices, hands)
    pairs = outline_pairs(surface, camera, 1, OutlineTree(outline_of(moved), scale), scale, 8.0)
    stacked = RigCameras.of(made_rig.cameras)
    vertices = torch.as_tensor(made_rig.vertices, dtype=torch.float32)
    (points,) = PairedViews.of([pairs], surface, vertices).points(vertices)
    px = stacked.project(points, 1, torch.zeros(4))[0]
    across, along = pairs.off_mm(px)
    facing = pairs.normal[:, 0].abs() > 0.9
    assert (across * -pairs.normal[:, 0].sign())[facing].median() == pytest.approx(3 / scale, abs=0.6)
    level = pairs.normal[:, 1].abs() > 0.95
    assert across[level].abs().median() < 1.0
    assert (along >= 0).all()


def test_pairs_beyond_their_reach_are_none(made_rig):
    hands, camera = made_rig.hands, made_rig.cameras[1]
    skin = covered_pixels(made_rig.vertices, hands.faces, camera).face != NONE
    tree = OutlineTree(outline_of(np.roll(skin, 12, 1)), 1.0)
    surface = OutlinedGeometry.of_meshes(made_rig.vertices, hands)
    near, far = (outline_pairs(surface, camera, 1, tree, 1.0, reach) for reach in (3.0, 30.0))
    assert len(near.px) < len(far.px)
    vertices = torch.as_tensor(made_rig.vertices, dtype=torch.float32)
    assert PairedViews.of([near._replace(px=near.px[:0])], surface, vertices).views == ()


def test_points_of_a_finer_surface_follow_the_meshes(made_rig):
    hands, camera = made_rig.hands, made_rig.cameras[1]
    vertices = torch.as_tensor(made_rig.vertices, dtype=torch.float32)
    step = loop_step(hands.faces.numpy(), len(vertices))
    level, faces = SubdivisionLevel.of(step), torch.as_tensor(step.faces)
    beside = 0.001 * torch.randn(step.vertex_count, 3, generator=torch.Generator().manual_seed(0))
    finer = (level(vertices) + beside).double().numpy()
    sums = csr_array((step.value, (step.row, step.column)))
    surface = OutlinedGeometry(finer, faces, torch.zeros(len(faces), dtype=torch.bool), sums)
    skin = covered_pixels(finer, faces, camera).face != NONE
    pairs = outline_pairs(surface, camera, 1, OutlineTree(outline_of(skin), 1.0), 1.0, 8.0)
    moved = vertices + 0.002 * torch.sin(100 * vertices)
    (points,) = PairedViews.of([pairs], surface, vertices).points(moved)
    expected = ((level(moved) + beside)[pairs.corners] * pairs.weights[..., None]).sum(1)
    assert len(pairs.px) > 100
    torch.testing.assert_close(points, expected, atol=1e-6, rtol=0)
