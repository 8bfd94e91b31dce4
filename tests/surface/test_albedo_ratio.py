"""The factor on albedo: means of its pyramid, samples at texels, the storage's steps, and vertices of a mesh."""

import numpy as np
import torch
from livehand.backend.surface.albedo_ratio import (
    RATIO_ARRAY,
    RATIO_STEP,
    AlbedoRatio,
    ratio_steps,
    vertex_ratio,
    without_marks,
)

A = 64


def even(red, green, blue):
    return np.tile(np.array([red, green, blue], np.int8), (A, A, 1))


def test_levels_hold_means_of_factors_not_of_logarithms():
    steps = even(0, 0, 0)
    steps[::2, :, 0] = 100  # every other row
    ratio = AlbedoRatio.of(steps)
    coarse = ratio.sample(torch.tensor([[0.5, 0.5]]), torch.tensor([1.0]))[0]
    assert abs(coarse[0] - np.log((1 + np.exp(100 * RATIO_STEP)) / 2)) <= RATIO_STEP / 2
    assert coarse[1] == coarse[2] == 0


def test_samples_in_the_middle_of_a_texel_are_its_value():
    steps = np.random.default_rng(1).integers(-127, 127, (A, A, 3), np.int8)
    uv = torch.tensor([[(10 + 0.5) / A, (20 + 0.5) / A]])
    found = AlbedoRatio.of(steps).sample(uv, torch.zeros(1))[0]
    np.testing.assert_allclose(found, steps[20, 10] * RATIO_STEP, atol=1e-4)


def test_between_two_levels_it_is_between_their_values():
    steps = np.random.default_rng(2).integers(-60, 60, (A, A, 3), np.int8)
    ratio, uv = AlbedoRatio.of(steps), torch.tensor([[0.3, 0.7]])
    fine, middle, coarse = (ratio.sample(uv, torch.tensor([level])) for level in (1.0, 1.25, 2.0))
    torch.testing.assert_close(middle, 0.75 * fine + 0.25 * coarse)


def test_steps_are_rounded_and_bounded():
    assert ratio_steps(torch.tensor([0.0, 0.0149, -9.0, 9.0])).tolist() == [0, 1, -127, 127]


def test_vertices_have_the_mean_of_their_corners():
    left_dark = even(0, 0, 0)
    left_dark[:, : A // 2] = -100
    faces = np.array([[0, 1, 2], [2, 1, 3]])
    uv = np.array([[[0.1, 0.1], [0.2, 0.1], [0.1, 0.2]], [[0.9, 0.9], [0.8, 0.1], [0.9, 0.2]]])
    found = vertex_ratio({RATIO_ARRAY: left_dark}, uv, faces)
    dark = np.exp(-100 * RATIO_STEP)
    np.testing.assert_allclose(found[0], dark, atol=1e-4)
    np.testing.assert_allclose(found[1], (dark + 1) / 2, atol=1e-4)
    np.testing.assert_allclose(found[3], 1, atol=1e-6)


def test_a_surface_without_it_has_no_factor():
    assert vertex_ratio({}, np.zeros((1, 3, 2)), np.array([[0, 1, 2]])) is None


def marked():
    steps, marks = even(20, -10, 5), np.zeros((A // 2, A // 2), np.uint8)
    steps[20:24, 10:30] = -90
    marks[10:12, 5:15] = 255
    return steps, marks


def test_marks_are_filled_with_what_is_around_and_nothing_else_changes():
    steps, marks = marked()
    np.testing.assert_array_equal(without_marks(steps, marks), even(20, -10, 5))
    steps[40, 40] = 77
    assert (without_marks(steps, marks)[40, 40] == 77).all()


def test_half_a_mark_is_half_filled():
    steps, marks = marked()
    blended = without_marks(steps, (marks // 2).astype(np.uint8))[22, 20]
    np.testing.assert_allclose(blended, -90 + 127 / 255 * (np.array([20, -10, 5]) + 90), atol=0.5)


def test_an_atlas_that_is_all_mark_stays_finite():
    filled = without_marks(even(20, 0, 0), np.full((A, A), 255, np.uint8))
    assert np.isfinite(filled).all()


def test_the_other_hand_goes_without_a_hands_marks():
    steps, marks = marked()
    arrays = {RATIO_ARRAY: steps, "marks/right": marks}
    right, left = (AlbedoRatio.of_side(arrays, side) for side in ("right", "left"))
    row = 22 * A + 20
    assert right.table[row].tolist() == [-90, -90, -90]
    assert left.table[row].tolist() == [20, -10, 5]
    assert AlbedoRatio.of_side({"marks/right": marks}, "left") is None
