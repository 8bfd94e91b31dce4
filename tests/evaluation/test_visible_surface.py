"""The mesh in a view: depths of spheres by closed form, and openness of what is hidden and of what is not."""

import numpy as np
import pytest
import torch
from livehand.backend.evaluation.visible_surface import vertex_ambient_occlusion, visible_surface
from livehand.backend.field.rays import camera_tensors, ray_directions
from livehand.backend.records.camera import Camera, look_at

K = np.array([[300.0, 0, 24], [0, 300, 20], [0, 0, 1]])


def above(height=1.0):
    """Looks down the z axis."""
    return camera_tensors(
        Camera(K, look_at(np.array([0, 0, height]), np.zeros(3), np.array([0, 1.0, 0])), (48, 40)), "cpu"
    )


@pytest.mark.slow
def test_the_depth_of_a_sphere_is_exact(spheres):
    mesh, topology = spheres(((0, 0, 0), 0.05))
    view = above()
    surface = visible_surface(mesh, topology, torch.ones(len(mesh.vertices)), view)
    directions = ray_directions(view, torch.arange(48 * 40)).double()
    # |o + t d| = r with o = (0, 0, 1): the nearer root.
    a, b = (directions**2).sum(1), directions[:, 2]
    root = b**2 - a * (1 - 0.05**2)
    expected = torch.where(root >= 0, (-b - root.clamp(min=0).sqrt()) / a, torch.inf).reshape(40, 48)
    both = surface.depth.isfinite() & expected.isfinite()
    assert (surface.depth.isfinite() == expected.isfinite()).double().mean() > 0.98
    assert (surface.depth - expected)[both].abs().median() < 2e-4  # a subdivided icosphere is no sphere
    torch.testing.assert_close(surface.footprint[both], surface.depth[both] / 300)
    assert (surface.ambient_occlusion == 1).all()


def test_the_nearest_front_face_hides_the_others(spheres):
    mesh, topology = spheres(((0, 0, 0), 0.05), ((0, 0, 0.2), 0.02), subdivisions=3)
    ambient_occlusion = (mesh.vertices[:, 2] > 0.1).float()
    surface = visible_surface(mesh, topology, ambient_occlusion, above())
    middle = (20, 24)
    assert abs(float(surface.depth[middle]) - 0.78) < 2e-3
    assert surface.ambient_occlusion[middle] == 1  # the small sphere's
    assert surface.ambient_occlusion[20, 24 + 12] == 0  # beside it, the large one's
    assert surface.ambient_occlusion[0, 0] == 1
    assert surface.depth[0, 0].isinf()


def test_a_lone_sphere_is_open_and_a_gap_is_not(spheres):
    mesh, topology = spheres(((0, 0, 0), 0.05), subdivisions=3)
    assert vertex_ambient_occlusion(mesh, topology).min() > 0.9
    pair, both = spheres(((0, 0, -0.051), 0.05), ((0, 0, 0.051), 0.05), subdivisions=3)
    ambient_occlusion = vertex_ambient_occlusion(pair, both)
    at_gap = pair.vertices[:, 2].abs() < 0.004
    far_side = pair.vertices[:, 2].abs() > 0.09
    assert ambient_occlusion[at_gap].max() < 0.5
    assert ambient_occlusion[far_side].min() > 0.9
