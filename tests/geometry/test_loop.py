"""Loop's subdivision: known weights, a limit that is known, and affine invariance."""

import numpy as np
import pytest
import trimesh
from livehand.backend.geometry.loop import loop_step, split_corners

OCTAHEDRON = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
FACES = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [1, 0, 5], [2, 1, 5], [3, 2, 5], [0, 3, 5]])


def dense(step, count):
    matrix = np.zeros((step.vertex_count, count))
    np.add.at(matrix, (step.row, step.column), step.value)
    return matrix


def test_weights_of_an_octahedron():
    """Valence 4: each neighbour has (5/8 - (3/8)^2) / 4 of an old vertex; an edge's ends have 3/8, the others 1/8."""
    matrix = dense(loop_step(FACES, 6), 6)
    share = (5 / 8 - (3 / 8) ** 2) / 4
    np.testing.assert_allclose(matrix[4], [share, share, share, share, 1 - 4 * share, 0])
    of_edge = matrix[6:][(matrix[6:, [0, 1]] == 3 / 8).all(1)]
    np.testing.assert_allclose(of_edge, [[3 / 8, 3 / 8, 0, 0, 1 / 8, 1 / 8]])


def test_counts_faces_and_winding():
    step = loop_step(FACES, 6)
    assert (step.vertex_count, len(step.faces)) == (6 + 12, 4 * 8)
    finer = trimesh.Trimesh(dense(step, 6) @ OCTAHEDRON, step.faces, process=False)
    assert finer.is_watertight
    assert finer.is_winding_consistent
    assert finer.volume > 0


def test_any_affine_map_passes_through():
    step, generator = loop_step(FACES, 6), np.random.default_rng(0)
    turn, shift = generator.normal(size=(3, 3)), generator.normal(size=3)
    matrix = dense(step, 6)
    np.testing.assert_allclose(matrix @ (OCTAHEDRON @ turn + shift), matrix @ OCTAHEDRON @ turn + shift, atol=1e-12)


def test_faces_of_the_other_winding_have_the_same_weights():
    there, back = loop_step(FACES, 6), loop_step(FACES[:, ::-1], 6)
    np.testing.assert_array_equal(dense(there, 6), dense(back, 6))


def test_corners_of_the_finer_faces_are_the_middles_of_sides():
    """An atlas that is the place itself: at the corners of the finer faces it is the mean of the old ones."""
    fine = split_corners(OCTAHEDRON[FACES][..., :2])
    assert fine.shape == (32, 3, 2)
    np.testing.assert_allclose(fine[24:].mean(1), OCTAHEDRON[FACES][..., :2].mean(1))  # the middle faces
    np.testing.assert_allclose(fine[:8, 0], OCTAHEDRON[FACES][:, 0, :2])


@pytest.mark.parametrize("valence", [3, 5, 6])
def test_a_flat_disc_stays_flat_and_regular(valence):
    """A double pyramid squeezed flat: its tip's ring is symmetrical, so the tip stays where it is."""
    angle = 2 * np.pi * np.arange(valence) / valence
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(valence)], 1)
    vertices = np.vstack([ring, [[0, 0, 0], [0, 0, -1]]])
    turned = np.roll(np.arange(valence), -1)
    top = np.stack([np.arange(valence), turned, np.full(valence, valence)], 1)
    faces = np.vstack([top, np.stack([turned, np.arange(valence), np.full(valence, valence + 1)], 1)])
    moved = dense(loop_step(faces, len(vertices)), len(vertices)) @ vertices
    np.testing.assert_allclose(moved[valence], 0, atol=1e-12)
