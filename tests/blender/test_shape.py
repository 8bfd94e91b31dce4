import bpy
import numpy as np
import pytest
from livehand.backend.hand.measurements import length_and_breadth_m
from livehand.livehand_blender.ui.shape import shape_names


def test_match_measurements_fits_length_and_breadth(hand, model):
    assert bpy.ops.livehand.match_measurements(length_mm=200, breadth_mm=85) == {"FINISHED"}
    measured = length_and_breadth_m(model, np.array(hand["beta"]))
    np.testing.assert_allclose(measured, [0.200, 0.085], atol=2e-4)
    hand.livehand.model_path = "/no/such/hand.npz"
    with pytest.raises(RuntimeError, match="no hand model at"):
        bpy.ops.livehand.match_measurements(length_mm=200, breadth_mm=85)


def test_random_shape_depends_on_the_seed_and_can_be_reset(hand, evaluated_vertices, model):
    bpy.ops.livehand.random_shape(seed=3, strength=0.5)
    first = np.array(hand["beta"])
    bpy.ops.livehand.random_shape(seed=4)
    assert np.abs(first - hand["beta"]).max() > 0.3
    bpy.ops.livehand.random_shape(seed=3, strength=0.5)
    np.testing.assert_array_equal(hand["beta"], first)
    bpy.ops.livehand.reset_shape()
    np.testing.assert_allclose(evaluated_vertices(hand), model.v_template, atol=1e-6)


def test_only_the_built_in_hands_sliders_have_names(hand):
    assert shape_names(hand.livehand)[2] == "Finger Length"
    hand.livehand.model_path = "//mine.npz"
    assert shape_names(hand.livehand) == tuple(f"Beta {k}" for k in range(10))


def test_shape_names_describe_their_effect(hand, model):
    mean = length_and_breadth_m(model, np.zeros(10))
    longer, broader = np.array([length_and_breadth_m(model, one) / mean - 1 for one in np.eye(10)]).T
    names = np.array(shape_names(hand.livehand))
    assert len(names) == 10
    assert set(names[longer > 0.006]) == {"Size", "Finger Length"}
    assert set(names[broader > 0.02]) == {"Size", "Thickness", "Palm Breadth"}
