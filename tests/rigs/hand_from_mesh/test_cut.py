"""The hand cut out of a character: a hand on a long arm, with seams, nails and a body beside it."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.geometry.mesh_tables import (
    connected_components,
    merged_vertices,
    open_half_edges,
    pinched_vertices,
    repeated_half_edges,
)
from livehand.backend.hand.cap import capped
from livehand.backend.records.errors import LiveHandError
from livehand.backend.rigs.hand_from_mesh.cut import Wrist, cut_hand
from livehand.backend.rigs.hand_from_mesh.skinned_surface import SkinnedSurface

# A grid that is rolled up: rings of SIDES vertices along x, the hand's from x = 0 to -0.1, its arm up to 0.3.
SIDES, RINGS = 12, 41
WRIST = Wrist(np.zeros(3), np.array([1.0, 0, 0]), 0.03)


def tube(x, radius=0.03):
    """Rings of vertices at places x, quads as two triangles each; closed by a point at the least x."""
    turn = 2 * np.pi * np.arange(SIDES) / SIDES
    rings = [np.stack([np.full(SIDES, place), radius * np.cos(turn), radius * np.sin(turn)], -1) for place in x]
    vertices = np.concatenate([*rings, [[x[0] - 0.01, 0, 0]]])
    faces, polygons = [], []
    for ring in range(len(x) - 1):
        for k in range(SIDES):
            a, b = ring * SIDES + k, ring * SIDES + (k + 1) % SIDES
            faces += [[a, a + SIDES, b + SIDES], [a, b + SIDES, b]]
            polygons += [len(polygons) // 2] * 2
    first = polygons[-1] + 1
    faces += [[(k + 1) % SIDES, len(vertices) - 1, k] for k in range(SIDES)]
    polygons += [first + k for k in range(SIDES)]
    return vertices, np.array(faces), np.array(polygons)


@pytest.fixture
def character():
    """The tube as hand and arm; weights of the joints [N, 16] with fingers at its end; the hand's share of each."""
    vertices, faces, polygons = tube(np.linspace(-0.1, 0.3, RINGS))
    share = np.clip(0.5 - vertices[:, 0] / 0.02, 0, 1)
    weights = np.zeros((len(vertices), 16))
    weights[:, 5] = np.clip(-vertices[:, 0] / 0.1, 0, 1)
    weights[:, 0] = 1 - weights[:, 5]
    return SkinnedSurface(vertices, faces, polygons, np.ones((len(vertices), 1))), weights, share


def with_more(character, vertices, faces, polygons, joint, share):
    """Another piece beside it."""
    surface, weights, shares = character
    count = len(surface.vertices_m)
    more = np.zeros((len(vertices), 16))
    more[:, joint] = 1
    surface = SkinnedSurface(
        np.concatenate([surface.vertices_m, vertices]),
        np.concatenate([surface.faces, faces + count]),
        np.concatenate([surface.polygons, polygons + surface.polygons.max() + 1]),
        np.ones((count + len(vertices), 1)),
    )
    return surface, np.concatenate([weights, more]), np.r_[shares, np.full(len(vertices), share)]


def split_along_seams(surface):
    """A vertex for each corner of each face, as files with flat shading have them, and whose each was."""
    own = surface.faces.ravel()
    faces = np.arange(len(own)).reshape(-1, 3)
    return replace(surface, vertices_m=surface.vertices_m[own], faces=faces, weights=surface.weights[own]), own


def test_the_stump_ends_behind_the_wrist_and_caps(character):
    surface, weights, share = character
    cut = cut_hand(surface, weights, share, WRIST)
    x = surface.vertices_m[cut.source, 0]
    assert 0.015 < x.max() < 0.03
    assert x.min() == surface.vertices_m[:, 0].min()
    assert len(open_half_edges(cut.faces)) == SIDES  # one ring, straight across
    assert len(open_half_edges(capped(surface.vertices_m[cut.source], cut.faces))) == 0
    np.testing.assert_array_equal(cut.vertex_of[cut.source], np.arange(len(cut.source)))
    np.testing.assert_array_equal(np.unique(surface.polygons[np.isin(surface.polygons, cut.polygons)]), cut.polygons)
    assert cut.other_pieces == 0


def test_a_hand_without_a_forearm_is_kept_whole(character):
    surface, weights, _ = character
    cut = cut_hand(surface, weights, np.ones(len(weights)), WRIST)
    assert len(cut.source) == len(surface.vertices_m)
    assert len(cut.polygons) == surface.polygons.max() + 1


def test_a_crooked_cut_is_made_sound(character):
    """Two faces of the arm that meet in one corner only: the open edge would meet itself there."""
    surface, weights, share = character
    surface = replace(surface, polygons=np.arange(len(surface.faces)))
    ring = int(np.flatnonzero(surface.vertices_m[:, 0] < 0.03)[-2] // SIDES)  # the last before the cut
    beyond = [(ring + 1) * SIDES, (ring + 1) * SIDES + 1, (ring + 2) * SIDES, (ring + 2) * SIDES + 1]
    share[[*beyond, (ring + 2) * SIDES + 2, (ring + 1) * SIDES + 5]] = 1.0
    share[(ring + 1) * SIDES + 1] = 0.0
    cut = cut_hand(surface, weights, share, WRIST)
    assert len(pinched_vertices(cut.faces)) == 0
    capped(surface.vertices_m[cut.source], cut.faces)


def test_body_and_nails_are_left_out(character):
    leg = tube(np.linspace(-0.3, -0.05, 30))
    nail = tube(np.linspace(-0.1, -0.09, 2), radius=0.004)
    both = with_more(with_more(character, *leg, joint=0, share=0.0), *nail, joint=6, share=1.0)
    cut, alone = cut_hand(*both, WRIST), cut_hand(*character, WRIST)
    np.testing.assert_array_equal(cut.source, alone.source)
    np.testing.assert_array_equal(cut.faces, alone.faces)
    assert (cut.vertex_of[len(character[0].vertices_m) :] == -1).all()
    assert cut.other_pieces == 1  # the nail; the leg is no part of the hand


def test_a_prop_out_of_reach_is_left_out_and_a_finger_of_its_own_is_not(character):
    sword = tube(np.linspace(-0.5, -0.12, 20), radius=0.01)
    finger = tube(np.linspace(-0.16, -0.12, 8), radius=0.008)
    whole = with_more(with_more(character, *sword, joint=0, share=1.0), *finger, joint=9, share=1.0)
    cut = cut_hand(*whole, replace(WRIST, reach_m=0.2))
    assert cut.other_pieces == 1
    kept = whole[0].vertices_m[cut.source, 0]
    assert kept.min() == pytest.approx(-0.17)
    assert len(cut.source) == len(cut_hand(*character, WRIST).source) + len(finger[0])


def test_seams_are_welded(character):
    surface, weights, share = character
    split, own = split_along_seams(surface)
    whole, cut = cut_hand(surface, weights, share, WRIST), cut_hand(split, weights[own], share[own], WRIST)
    assert len(cut.source) == len(whole.source)
    assert len(open_half_edges(cut.faces)) == SIDES
    np.testing.assert_array_equal(cut.polygons, whole.polygons)
    inside = cut.vertex_of >= 0
    points = split.vertices_m[cut.source][cut.vertex_of[inside]]
    np.testing.assert_array_equal(points, split.vertices_m[inside])


def test_welding_joins_near_vertices_of_open_edges_only():
    rng = np.random.default_rng(1)
    faces = np.arange(300).reshape(-1, 3)
    points = rng.uniform(0, 1, (100, 3))
    vertices = np.concatenate([points + rng.uniform(-1, 1, points.shape) * 1e-7 for _ in range(3)])
    order = np.tile(np.arange(100), 3)
    assert (merged_vertices(vertices, faces, 1e-5) == order).mean() > 0.99  # a cell's corner may fall between two twins
    closed = np.array([[0, 1, 2], [0, 2, 1]])
    np.testing.assert_array_equal(merged_vertices(np.zeros((3, 3)), closed, 1e-5), [0, 1, 2])


def test_errors_of_non_manifold_meshes_name_the_joint(character):
    surface, weights, share = character
    torn = replace(
        surface,
        faces=np.concatenate([surface.faces, [[0, 1, 3 * SIDES]]]),
        polygons=np.r_[surface.polygons, surface.polygons.max() + 1],
    )
    assert len(repeated_half_edges(torn.faces)) == 1
    with pytest.raises(LiveHandError, match="1 edges that are not so, near middle2"):
        cut_hand(torn, weights, share, WRIST)
    assert len(repeated_half_edges(surface.faces)) == 0


def test_a_mesh_without_fingers_or_without_hand_is_refused(character):
    surface, weights, share = character
    with pytest.raises(LiveHandError, match="fingers' bones move, got none"):
        cut_hand(surface, np.eye(16)[np.zeros(len(weights), int)], share, WRIST)
    with pytest.raises(LiveHandError, match="hand's bones move, got none"):
        cut_hand(surface, weights, share * 0, replace(WRIST, stump_m=-1.0))


def test_components_are_what_hangs_together():
    faces = np.array([[0, 1, 2], [5, 6, 4], [2, 3, 1], [6, 7, 5]])
    np.testing.assert_array_equal(connected_components(faces, 9), [0, 0, 0, 0, 4, 4, 4, 4, 8])
