"""Atlases and caps: charts that do not overlap, hands that are closed."""

import numpy as np
import pytest
import trimesh
from livehand.backend.hand.atlas import unwrap, unwrap_millimetres, with_cap_chart
from livehand.backend.hand.cap import cap_faces, capped, flat_cap
from livehand.backend.hand.model_file import builtin_hand_path, load_hand_model
from livehand.backend.records.errors import LiveHandError

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def open_faces(hand):
    """The built-in hand without its stump: open at the wrist, as MANO is."""
    is_stump = (hand.v_template[hand.f, 0] > 0.12).any(1)
    return hand.f[~is_stump]


def write_hand(path, **changes):
    with np.load(builtin_hand_path()) as archive:
        arrays = {**archive, **changes}
    np.savez(path, **{key: value for key, value in arrays.items() if value is not None})
    return path


def assert_closed(vertices, faces):
    """Closed, wound outward, each edge between two faces; unused vertices do not matter."""
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0


def test_a_box_without_a_lid_gets_the_lid_back():
    box = trimesh.creation.box()
    is_lid = box.face_normals[:, 2] > 0.5
    faces = capped(box.vertices, np.asarray(box.faces)[~is_lid])
    assert_closed(box.vertices, faces)
    assert len(faces) == 12
    assert trimesh.Trimesh(box.vertices, faces, process=False).volume == pytest.approx(1.0)


def test_open_wrist_is_closed_over_its_own_vertices(hand, open_faces):
    faces = capped(hand.v_template, open_faces)
    assert_closed(hand.v_template, faces)
    np.testing.assert_array_equal(faces[: len(open_faces)], open_faces)
    (cap,) = cap_faces(hand.v_template, open_faces)
    assert len(cap) == len(np.unique(cap)) - 2
    normals = np.cross(*(hand.v_template[cap[:, k]] - hand.v_template[cap[:, 0]] for k in (1, 2)))
    assert normals.sum(0)[0] > 0.8 * np.linalg.norm(normals.sum(0))  # outward: away from the fingers, +X


def open_cone(rim):
    """A cone over a rim [n, 3] around the z axis, its apex below and last, open above."""
    n = len(rim)
    return np.vstack([rim, [[0, 0, -1]]]), np.array([[(i + 1) % n, i, n] for i in range(n)])


def test_a_crooked_rim_with_a_slit_is_closed_without_folds():
    """The shortest cut of all spans the slit's mouth, outside the opening."""
    angle = np.array([-0.05, 0.0, 0.05, 1.0, 2.0, 3.0, 4.0, 5.0])
    radius = np.where(angle == 0, 0.5, 1.0)
    vertices, cone = open_cone(np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.2 * np.sin(3 * angle)], 1))
    faces = capped(vertices, cone)
    assert_closed(vertices, faces)
    seen_from_above = signed_areas(vertices[:, :2], faces[8:])
    assert (seen_from_above > 0).all()
    assert seen_from_above.sum() == pytest.approx(-signed_areas(vertices[:, :2], cone).sum())


def test_a_cut_never_runs_along_an_edge_of_the_surface():
    """A flap on the rim: its tip is the ear with the shortest cut, but that cut is the flap's own foot."""
    angle = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    vertices, cone = open_cone(np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1))
    tip = (vertices[0] + vertices[1]) * 0.6
    vertices, faces = np.vstack([vertices, tip]), np.vstack([cone, [[0, 1, 9]]])
    assert_closed(vertices, capped(vertices, faces))


def test_random_holes_are_closed(hand):
    rng = np.random.default_rng(3)
    closed = 0
    for _ in range(20):
        seed = rng.integers(len(hand.v_template))
        near = np.linalg.norm(hand.v_template - hand.v_template[seed], axis=1) < 0.012
        try:
            faces = capped(hand.v_template, hand.f[~near[hand.f].any(1)])
        except LiveHandError:
            continue  # the hole touched itself
        assert_closed(hand.v_template, faces)
        closed += 1
    assert closed > 10


def test_two_openings_are_closed(hand, open_faces):
    tip = hand.v_template[:, 0].argmin()
    faces = open_faces[~(open_faces == tip).any(1)]
    assert len(cap_faces(hand.v_template, faces)) == 2
    assert_closed(hand.v_template, capped(hand.v_template, faces))


def test_a_surface_that_cannot_be_capped_is_refused(hand):
    flipped = hand.f.copy()
    flipped[7] = flipped[7, ::-1]
    with pytest.raises(LiveHandError, match="wound alike"):
        capped(hand.v_template, flipped)
    bow = np.array([[0, 1, 2], [0, 3, 4]])
    with pytest.raises(LiveHandError, match="touch itself"):
        capped(np.random.default_rng(0).normal(size=(5, 3)), bow)


def test_a_closed_hand_is_left_alone(hand):
    with np.load(builtin_hand_path()) as archive:
        np.testing.assert_array_equal(hand.f, archive["f"])
        np.testing.assert_array_equal(hand.ft, archive["ft"])
        np.testing.assert_array_equal(hand.vt, archive["vt"])
    np.testing.assert_array_equal(capped(hand.v_template, hand.f), hand.f)


def test_an_open_file_without_an_atlas_is_capped_and_unwrapped(hand, open_faces, tmp_path):
    loaded = load_hand_model(write_hand(tmp_path / "open.npz", f=open_faces, vt=None, ft=None))
    assert_closed(loaded.v_template, loaded.f)
    assert len(loaded.v_template) == len(hand.v_template)
    assert loaded.ft.shape == loaded.f.shape
    assert loaded.vt.min() >= 0
    assert loaded.vt.max() <= 1
    assert_no_overlap(loaded.vt, loaded.ft)


def test_an_open_file_keeps_its_atlas_and_the_cap_takes_free_room(hand, open_faces, tmp_path):
    kept = (hand.f[:, None] == open_faces[None]).all(-1).any(1)
    path = write_hand(tmp_path / "open.npz", f=open_faces, ft=hand.ft[kept])
    loaded = load_hand_model(path)
    assert_closed(loaded.v_template, loaded.f)
    np.testing.assert_array_equal(loaded.vt[: len(hand.vt)], hand.vt)
    np.testing.assert_array_equal(loaded.ft[: len(open_faces)], hand.ft[kept])
    assert loaded.ft.shape == loaded.f.shape
    assert loaded.vt.min() >= 0
    assert loaded.vt.max() <= 1
    assert_no_overlap(loaded.vt, loaded.ft)
    cap = loaded.ft[len(open_faces) :]
    assert (signed_areas(loaded.vt, cap) > 0).all()
    assert cap.min() >= len(hand.vt)


def test_an_atlas_without_free_space_is_refused():
    vt, ft = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]]), np.array([[0, 1, 2], [0, 2, 3]])
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    with pytest.raises(LiveHandError, match="leave out vt and ft"):
        with_cap_chart(vt, ft, square, ft, ft[:, ::-1])


def test_a_cap_chart_has_the_mean_scale_where_there_is_room():
    vt = np.array([[0, 0], [0.25, 0], [0.25, 0.25], [0, 0.25]])
    square, faces = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]]), np.array([[0, 1, 2], [0, 2, 3]])
    new_vt, new_ft = with_cap_chart(vt, faces, square, faces, faces[:, ::-1])
    chart = new_vt[new_ft[2:]]
    assert np.ptp(chart.reshape(-1, 2), axis=0) == pytest.approx([0.25, 0.25])
    assert (chart > 0.25).any(-1).all()
    assert_no_overlap(new_vt, new_ft)


def test_a_flat_cap_keeps_lengths_and_orientation():
    vertices = np.array([[0, 0, 0], [0, 2, 0], [0, 2, 3], [0, 0, 3.0]])
    points, faces = flat_cap(vertices, np.array([[0, 1, 2], [0, 2, 3]]))
    assert sorted(np.ptp(points, axis=0)) == pytest.approx([2, 3])
    assert points.min(0) == pytest.approx([0, 0])
    assert (signed_areas(points, faces) > 0).all()
    assert signed_areas(points, faces).sum() == pytest.approx(6)


def test_unwrapped_charts_cover_and_do_not_overlap(hand):
    vt, ft = unwrap(hand.v_template, hand.f)
    assert ft.shape == hand.f.shape
    assert vt.min() >= 0
    assert vt.max() <= 1
    assert np.abs(signed_areas(vt, ft)).sum() > 0.5
    assert_no_overlap(vt, ft)
    # every corner of a vertex keeps its place in space, whatever chart it is in
    vertex_of = np.full(len(vt), -1)
    vertex_of[ft.ravel()] = hand.f.ravel()
    np.testing.assert_array_equal(vertex_of[ft], hand.f)


def test_unwrap_does_not_depend_on_the_unit_and_is_repeatable(hand):
    first, again = unwrap(hand.v_template, hand.f), unwrap(hand.v_template, hand.f)
    np.testing.assert_array_equal(first[0], again[0])
    millimetres = unwrap_millimetres(hand.v_template * 1e3, hand.f)
    assert len(millimetres[0]) == len(first[0])


def signed_areas(vt, ft):
    a, b, c = (vt[ft[:, k]] for k in range(3))
    return np.cross(b - a, c - a) / 2


def assert_no_overlap(vt, ft, count=4000):
    """Points drawn inside the faces lie in no other face."""
    rng = np.random.default_rng(0)
    face = rng.integers(len(ft), size=count)
    share = rng.dirichlet([2, 2, 2], size=count)
    points = np.einsum("nk,nkc->nc", share, vt[ft[face]])
    a, b, c = (vt[ft[:, k]][None] for k in range(3))
    for chunk in range(0, count, 500):
        p = points[chunk : chunk + 500, None]
        sides = np.stack([np.cross(q - o, p - o) for o, q in ((a, b), (b, c), (c, a))])
        inside = (sides > 1e-9).all(0) | (sides < -1e-9).all(0)
        inside[np.arange(len(p)), face[chunk : chunk + 500]] = False
        assert not inside.any()
