"""An avatar's skin as textures: tangent-space normals of known slopes, and what the maps of a shipped avatar hold."""

import numpy as np
import pytest
import torch
from livehand.backend.avatars.file import load_avatar
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.render.textures.atlas_textures import _TexelFrames, atlas_textures
from livehand.backend.render.textures.textured_hand import textured_hand
from livehand.backend.surface.atlas_texels import AtlasTexels

pytestmark = pytest.mark.slow

RESOLUTION = 16
SCALE = 4.0  # units of u and v per metre


@pytest.fixture(scope="module")
def avatar():
    return load_avatar(shipped_avatar_path("light"))


def plane(mirror):
    """A square in space whose u runs along its first side, or backwards, and its v along the second."""
    turn = axis_angle_to_matrix(np.array([0.3, -0.8, 0.5]))
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) / SCALE
    uv = corners[:, :2] * SCALE
    if mirror:
        uv[:, 0] = 1 - uv[:, 0]
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    vertices = torch.as_tensor(corners @ turn.T, dtype=torch.float32)
    return vertices, torch.as_tensor(uv[faces], dtype=torch.float32), torch.as_tensor(faces)


@pytest.mark.parametrize("mirror", [False, True])
def test_normals_lean_against_the_slopes_of_u_and_v(mirror):
    vertices, corner_uv, faces = plane(mirror)
    texels = AtlasTexels.of(corner_uv, faces, RESOLUTION)
    slopes = torch.tensor([[0.05, -0.12]]).repeat(len(texels.pixel), 1)  # m per unit of u and v
    found = _TexelFrames(vertices, corner_uv, faces).tangent_normals(texels, slice(None), slopes).numpy()
    wanted = np.array([-0.05 * SCALE, 0.12 * SCALE, 1])
    np.testing.assert_allclose(found, np.tile(wanted / np.linalg.norm(wanted), (len(found), 1)), atol=1e-6)


def test_textures_are_those_of_skin(avatar, hand):
    """Albedo of skin, rough skin, smooth nails, relief that leans both ways and mostly outward."""
    albedo, normal, roughness = atlas_textures(avatar, hand, 128)
    assert albedo.shape == normal.shape == (128, 128, 3)
    assert 0.05 < albedo.min()
    assert albedo.max() < 0.95
    assert (albedo.reshape(-1, 3).mean(0)[:-1] > albedo.reshape(-1, 3).mean(0)[1:]).all()  # red over green over blue
    np.testing.assert_allclose(np.linalg.norm(normal, axis=-1), 1, atol=1e-5)
    assert normal[..., 2].mean() > 0.9
    assert np.abs(normal[..., :2].reshape(-1, 2).mean(0)).max() < 0.05
    assert normal[..., :2].std() > 0.01
    assert 0.2 < roughness.min() < 0.35 < roughness.mean() < 0.9


def test_the_mesh_is_the_avatars_surface(avatar, hand):
    made = textured_hand(avatar, hand, np.zeros(10), 32)
    assert len(made.vertices) == made.faces.max() + 1 > 10 * len(hand.v_template)
    np.testing.assert_allclose(made.weights.sum(1), 1, atol=1e-5)
    assert made.weights.min() > -1e-6
    assert made.morphs.displacements.shape[1:] == made.vertices.shape
    assert len(made.morphs.displacements) > len(made.morphs.correctives) > 0
    # The template's own vertices come first; subdivision and the person's own shape move them, by 2.4 mm at most.
    assert np.linalg.norm(made.vertices[: len(hand.v_template)] - hand.v_template, axis=1).max() < 3e-3
    left = textured_hand(avatar, hand.for_side("left"), np.zeros(10), 32)
    np.testing.assert_allclose(left.vertices * [-1, 1, 1], made.vertices, atol=1e-5)
