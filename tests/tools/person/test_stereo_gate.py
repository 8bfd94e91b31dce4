"""Poses against two cameras' truth: lenses are read, and figures are those of closed forms."""

import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.tools.person.stereo_gate import (
    aligned,
    bends_rad,
    bones_vary_mm,
    gates_of,
    information_of,
    jitter_mm,
    off_by,
    read_lens,
)
from livehand.tools.person.stereo_truth import CHAINS, Path3D, StereoTruth

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


def test_bones_vary_by_their_standard_deviation(points):
    still = np.repeat(points[:1], 4, 0)
    assert bones_vary_mm(Path3D(still, np.arange(4))) == pytest.approx(0, abs=1e-9)
    length = np.linalg.norm(points[0, 3] - points[0, 4])
    still[:, 4] = still[:, 3] + np.array([[0.98], [1.02], [0.98], [1.02]]) * (still[:, 4] - still[:, 3])
    assert bones_vary_mm(Path3D(still, np.arange(4))) == pytest.approx(0.02 * 1000 * length / 20)


def test_what_is_told_beside_the_gates_asks_nothing(points):
    frames = np.arange(6)
    bent = points.copy()
    bent[:, CHAINS[1, -1]] += 0.02
    fits = [Path3D(points, frames), Path3D(bent, frames)]
    rows = information_of(fits, StereoTruth(plain=Path3D(points, frames), constant=Path3D(2 * points, frames)))
    assert [row.passes for row in rows] == [None] * 8
    assert [row.value for row in rows] == pytest.approx(
        [
            0,
            0,
            *off_by(fits[1], fits[0]),
            off_by(*fits)[0],
            *(k * bones_vary_mm(fits[0]) for k in (1, 2)),
            2 * jitter_mm(fits[0]),
        ],
        abs=1e-5,
    )
