"""Offsets of the detailed surface: none of flat faces, those of known moves, and those that ship."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.hand.builtin.detailed_surface import detailed_surface
from livehand.backend.hand.builtin.surface_offsets import OFFSETS, surface_offsets
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.hand.skin_detail import ATLAS_MM, OFFSET_STEP_MM, load_skin_detail

HAND = load_default_hand()


@pytest.fixture(scope="module")
def detail():
    return detailed_surface(HAND, levels=1)


def of_flat_faces(detail):
    """The detailed surface with every vertex on its flat face: in a corner or in the middle of a side."""
    parent = np.arange(len(detail.faces)) % len(HAND.f)
    corners, corner_uv = HAND.v_template[HAND.f][parent], HAND.vt[HAND.ft][parent]
    sides_uv = np.stack([corner_uv[:, 1] - corner_uv[:, 0], corner_uv[:, 2] - corner_uv[:, 0]], -1)
    share = np.linalg.solve(sides_uv[:, None], (detail.uv - corner_uv[:, :1])[..., None])[..., 0]
    assert ((share > -1e-6) & (share < 1 + 1e-6)).all()  # within their parents
    flat = corners[:, :1] + share[..., :1] * (corners[:, 1:2] - corners[:, :1])
    flat = flat + share[..., 1:] * (corners[:, 2:] - corners[:, :1])
    vertices = np.zeros_like(detail.vertices_m)
    vertices[detail.faces] = flat
    return replace(detail, vertices_m=vertices, forms=())


def test_flat_faces_have_no_offset(detail):
    found = surface_offsets(HAND, of_flat_faces(detail), ATLAS_MM, veins_mm=0.0)
    assert found.shape == (OFFSETS, OFFSETS, 3)
    np.testing.assert_allclose(found, 0, atol=1e-6)


def test_a_surface_that_is_moved_is_off_by_as_much(detail):
    """Its length is that of the move wherever the atlas is neither stretched nor pressed: in the median."""
    flat = of_flat_faces(detail)
    moved = replace(flat, vertices_m=flat.vertices_m + np.array([0.0003, 0, 0.0004]))
    found = surface_offsets(HAND, moved, ATLAS_MM, veins_mm=0.0)
    assert np.median(np.linalg.norm(found, axis=-1)) == pytest.approx(0.5, rel=0.15)
    assert np.ptp(found[..., 2]) > 0.9  # up on one side of the hand and down on the other


def test_the_maps_that_ship_are_those_of_this_surface(detail):
    shipped = load_skin_detail(HAND.sha256).offset_mm
    found = surface_offsets(HAND, detail, ATLAS_MM, veins_mm=0.25)
    assert shipped.shape == found.shape
    assert np.abs(shipped).max() <= 127 * OFFSET_STEP_MM
    assert np.corrcoef(shipped[..., 2].ravel(), found[..., 2].ravel())[0, 1] > 0.6  # of coarser triangles
    assert 0.05 < np.median(shipped[..., 2]) < 0.3
