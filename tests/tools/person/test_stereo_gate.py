"""Two cameras' truth: lenses are read, points triangulated come back, and figures are those of closed forms."""

import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.tools.person.stereo_gate import (
    CalibratedLens,
    Path3D,
    aligned,
    bends_rad,
    gates_of,
    jitter_mm,
    read_lens,
    straightened,
)

TURN = axis_angle_to_matrix(np.array([0.3, -0.8, 0.5]))


@pytest.fixture
def points():
    return np.random.default_rng(0).normal(0, 0.03, (6, 21, 3))


def test_a_lens_is_read_with_what_its_words_name(tmp_path):
    (tmp_path / "c1.dat").write_text("intrinsic:\n900 0 350 \n0 910 355 \n0 0 1 \ndistortion:\n.1 .2 .3 .4 .5 \n")
    rows = "\n".join(" ".join(map(str, row)) for row in TURN)
    (tmp_path / "rot_trans_c1.dat").write_text(f"R:\n{rows}\nT:\n1\n2\n3\n\n#another one\nR:\n1 0 0\n")
    lens = read_lens(tmp_path, 1)
    np.testing.assert_allclose(lens.K, [[900, 0, 350], [0, 910, 355], [0, 0, 1]])
    np.testing.assert_allclose(lens.distortion, [0.1, 0.2, 0.3, 0.4, 0.5])
    np.testing.assert_allclose(lens.world2cam, np.c_[TURN, [1, 2, 3]])


def test_a_lens_without_distortion_only_scales():
    cv2 = pytest.importorskip("cv2")
    assert cv2
    lens = CalibratedLens(np.array([[900.0, 0, 350], [0, 910, 355], [0, 0, 1]]), np.zeros(5), np.eye(3, 4))
    flat = np.random.default_rng(1).uniform(-0.3, 0.3, (2, 5, 2))
    np.testing.assert_allclose(straightened(flat * [900, 910] + [350, 355], lens), flat, atol=1e-9)


def test_a_similarity_is_taken_out(points):
    moved = 1.3 * points[0] @ TURN.T + [0.1, 0.2, 0.3]
    np.testing.assert_allclose(aligned(moved, points[0]), points[0], atol=1e-12)
    mirrored = points[0] * [-1, 1, 1]
    assert np.linalg.norm(aligned(mirrored, points[0]) - points[0], axis=1).mean() > 0.005


def test_bends_are_angles_between_bones():
    straight = np.zeros((1, 21, 3))
    straight[0, :, 0] = [0, *([1, 2, 3, 4] * 5)]
    bent = straight.copy()
    bent[0, 7:9] = [[2, 1, 0], [2, 2, 0]]  # the index finger from its second joint on
    off = bends_rad(bent) - bends_rad(straight)
    assert off[0, 1].tolist() == pytest.approx([0, np.pi / 2, 0])
    assert np.abs(np.delete(off, 1, 1)).max() == 0


def test_only_frames_that_follow_one_another_jitter():
    points = np.zeros((5, 21, 3))
    points[:, 1:, 0] = 0.001 * np.array([0, 1, 4, 9, 16])[:, None]  # second differences of 2 mm
    assert jitter_mm(Path3D(points, np.arange(5))) == pytest.approx(2 * 20 / 21)
    points[4] = 1.0
    assert jitter_mm(Path3D(points, np.array([0, 1, 2, 3, 9]))) == pytest.approx(2 * 20 / 21)


def test_a_fit_is_measured_in_the_frames_of_both(points):
    truth = Path3D(points, np.arange(6))
    fit = Path3D(points[2:] @ TURN.T, np.arange(2, 6))
    bends, joints, _ = (gate.value for gate in gates_of(fit, truth))
    assert (bends, joints) == pytest.approx((0, 0), abs=1e-5)
