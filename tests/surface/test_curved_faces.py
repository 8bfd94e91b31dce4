"""Curved faces against closed forms: of spheres, whose middles of arcs, outlines and areas are known."""

from math import pi

import numpy as np
import pytest
import torch
import trimesh
from livehand.backend.field.rays import CameraTensors, HandInView, camera_tensors
from livehand.backend.geometry.mesh import posed_mesh
from livehand.backend.hand.topology import topology_of
from livehand.backend.records.camera import Camera
from livehand.backend.surface.curved_faces import (
    FLAT_UP_TO_PX,
    ROUND_FROM_PX,
    SAGITTA_M,
    CurvedFaces,
    roundness_in,
)
from livehand.backend.surface.detail_mesh import DetailMesh, DetailTemplate, visible_surface
from livehand.backend.surface.detail_surface import load_detail_surface
from livehand.backend.surface.edge_antialiasing import SurfaceBones

RADIUS_M, SIZE_PX = 0.02, 64


def sphere(template, level):
    """A mesh with the normals of a sphere; and its faces split, with what else a template has."""
    mesh = trimesh.creation.icosphere(level, RADIUS_M)
    vertices, faces = torch.as_tensor(mesh.vertices, dtype=torch.float32), torch.as_tensor(np.array(mesh.faces))
    bones = SurfaceBones(torch.zeros(len(faces), dtype=torch.int8), torch.zeros(1, 1, dtype=torch.bool))
    corner_uv = torch.rand(len(faces), 3, 2, generator=torch.Generator().manual_seed(0))
    flex = torch.linspace(-1, 1, len(vertices))
    flat = DetailMesh(vertices, vertices / RADIUS_M, faces, corner_uv, flex, torch.tensor(1.0), bones, faces)
    return flat, CurvedFaces.of(template._replace(offset_m=vertices, faces=faces, corner_uv=corner_uv, bones=bones))


@pytest.fixture(scope="module")
def template(hand):
    return DetailTemplate.of(load_detail_surface(hand.sha256), hand)


@pytest.mark.parametrize("roundness", [0.0, 0.4, 1.0])
def test_a_spheres_arcs_are_as_high_as_the_cubic_has_them(template, roundness):
    """Of half an angle a: R cos a (1 + sin(a)^2 / 2), which the sphere exceeds by 3/8 R a^4; chords by R a^2 / 2."""
    flat, faces = sphere(template, 2)
    curved = faces.curved(flat, roundness)
    torch.testing.assert_close(curved.vertices[: len(flat.vertices)], flat.vertices, atol=0, rtol=0)
    first, second = flat.normals[faces.edges].double().unbind(1)
    cosine = (0.5 * (first + second)).norm(dim=1)
    expected = RADIUS_M * cosine * (1 + roundness * (1 - cosine**2) / 2)
    middles = curved.vertices[len(flat.vertices) :].double()
    torch.testing.assert_close(middles.norm(dim=1), expected, atol=2e-9, rtol=0)
    torch.testing.assert_close(curved.normals, curved.vertices / curved.vertices.norm(dim=1, keepdim=True))
    if roundness == 1:
        assert (RADIUS_M - expected).max() < 0.02 * (RADIUS_M * (1 - cosine)).max()


def test_faces_wind_as_before_and_values_are_the_means_of_ends(template):
    flat, faces = sphere(template, 2)
    curved = faces.curved(flat)
    solids = [trimesh.Trimesh(mesh.vertices.numpy(), mesh.faces.numpy(), process=False) for mesh in (curved, flat)]
    assert solids[0].is_watertight
    lacking, lacked = (4 / 3 * pi * RADIUS_M**3 - solid.volume for solid in solids)
    assert lacking == pytest.approx(lacked / 4, rel=0.15)  # edges half as long
    torch.testing.assert_close(curved.flex[len(flat.flex) :], flat.flex[faces.edges].mean(1))
    assert torch.equal(curved.coarse_faces, flat.faces)
    assert len(curved.bones.of_face) == len(curved.faces) == len(curved.corner_uv) == 4 * len(flat.faces)
    of_corner = curved.corner_uv[: len(flat.faces)]  # each face's first corner, and the middles beside it
    torch.testing.assert_close(of_corner[:, 0], flat.corner_uv[:, 0])
    torch.testing.assert_close(of_corner[:, 1], flat.corner_uv[:, :2].mean(1))
    torch.testing.assert_close(curved.vertices[curved.faces[: len(flat.faces), 0]], flat.vertices[flat.faces[:, 0]])


def test_a_curved_spheres_outline_lacks_a_quarter_of_what_a_polygon_lacks_of_a_disc(template):
    """By parallel rays; its edges are half as long."""
    flat, faces = sphere(template, 2)
    px_per_m = 0.45 * SIZE_PX / RADIUS_M
    K = torch.tensor([[px_per_m, 0, SIZE_PX / 2], [0, px_per_m, SIZE_PX / 2], [0, 0, 1.0]])
    world2cam = torch.eye(4)
    world2cam[2, 3] = 1.0
    camera, area = CameraTensors(K, world2cam, (SIZE_PX, SIZE_PX), is_orthographic=True), pi * (0.45 * SIZE_PX) ** 2
    shown, straight = (float(visible_surface(mesh, camera).coverage.sum()) for mesh in (faces.curved(flat), flat))
    assert 0.015 * area < area - straight < 0.03 * area
    assert area - shown == pytest.approx((area - straight) / 4, abs=1e-3 * area)


def test_what_is_flat_stays_flat(template):
    """A box whose normals are its sides': no vertex of a side leaves it."""
    box = trimesh.creation.box((1, 1, 1))
    flat, _ = sphere(template, 0)
    vertices, faces = torch.as_tensor(box.vertices, dtype=torch.float32), torch.as_tensor(np.array(box.faces))
    up = torch.tensor([0.0, 0.0, 1.0]).expand(len(vertices), 3)
    bones = flat.bones._replace(of_face=torch.zeros(len(faces), dtype=torch.int8))
    split = CurvedFaces.of(
        template._replace(offset_m=vertices, faces=faces, corner_uv=torch.zeros(len(faces), 3, 2), bones=bones)
    )
    mesh = flat._replace(vertices=vertices, normals=up, faces=faces, flex=torch.zeros(len(vertices)), bones=bones)
    middles = split.curved(mesh).vertices[len(vertices) :]
    chords = vertices[split.edges].mean(1)
    is_level = (vertices[split.edges][:, 0, 2] - vertices[split.edges][:, 1, 2]).abs() < 1e-6
    torch.testing.assert_close(middles[is_level], chords[is_level])
    assert is_level.sum() >= 8


def test_edges_grow_round_as_their_sagittas_grow_in_the_image(hand):
    """The nearest vertex decides; the image is twice as large as the rays', and a hand twice the size twice as near."""
    topology, focal_px = topology_of(hand), 300.0
    K = np.array([[focal_px, 0, 24.0], [0, focal_px, 20.0], [0, 0, 1.0]])
    for scale in (1.0, 2.0):
        vertices = torch.as_tensor(scale * hand.v_template, dtype=torch.float32)
        mesh = posed_mesh(topology, vertices)
        middle_px = 0.5 * (FLAT_UP_TO_PX + ROUND_FROM_PX)
        for sagitta_px, expected in ((0.99 * FLAT_UP_TO_PX, 0), (middle_px, 0.5), (1.01 * ROUND_FROM_PX, 1)):
            cam2world = np.eye(4)
            cam2world[2, 3] = float(vertices[:, 2].min()) - scale * 2 * SAGITTA_M * focal_px / sagitta_px
            camera = camera_tensors(Camera(K, cam2world, (48, 40)), "cpu")
            assert roundness_in(HandInView(mesh, topology, camera)) == pytest.approx(expected, abs=2e-3)
        behind = np.eye(4)
        behind[2, 3] = float(vertices[:, 2].mean())
        within = camera_tensors(Camera(K, behind, (48, 40)), "cpu")
        assert roundness_in(HandInView(mesh, topology, within)) == 1


def test_most_of_the_surfaces_edges_are_flatter_than_is_allowed_for(hand, template, fine_hand):
    faces = CurvedFaces.of(template)
    for gesture in ("open", "Fist"):
        flat = fine_hand(gesture)
        middles = faces.curved(flat).vertices[len(flat.vertices) :]
        bow_m = (middles - flat.vertices[faces.edges].mean(1)).norm(dim=1)
        assert (bow_m < SAGITTA_M).float().mean() > 0.94
