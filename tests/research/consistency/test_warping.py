"""Skin is found again in other frames: paint that moves with it does not differ, what flickers is measured."""

import numpy as np
import pytest
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.research.consistency.warping import MeshView, warped

SIZE = (96, 80)


def plane(shift_m=0.0, turn_deg=0.0, divisions=12):
    """A square of 20 cm in the plane z = 0, moved along x, seen from above by a camera that is turned about z."""
    line = np.linspace(-0.1, 0.1, divisions + 1)
    x, y = np.meshgrid(line, line, indexing="ij")
    vertices = np.stack([x.ravel() + shift_m, y.ravel(), np.zeros(x.size)], -1)
    corner = (np.arange(divisions)[:, None] * (divisions + 1) + np.arange(divisions)).ravel()
    across, up = corner + divisions + 1, corner + 1
    faces = np.concatenate([np.stack([corner, across, up], -1), np.stack([across, across + 1, up], -1)])
    angle = np.deg2rad(turn_deg)
    K = np.array([[120.0, 0, SIZE[0] / 2], [0, 120, SIZE[1] / 2], [0, 0, 1]])
    up_axis = np.array([np.sin(angle), np.cos(angle), 0])
    return MeshView(vertices, faces, Camera(K, look_at(np.array([0, -0.001, 0.3]), np.zeros(3), up_axis), SIZE))


def painted(view, shift_m=0.0, brightness=0.0):
    """What the camera sees if the square is painted with a smooth pattern of its own places."""
    columns, rows = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    rays, origin = view.camera.ray_directions(np.stack([columns, rows], -1)), view.camera.cam2world[:3, 3]
    points = origin - rays * (origin[2] / rays[..., 2])[..., None]
    x, y = points[..., 0] - shift_m, points[..., 1]
    pattern = 0.5 + 0.2 * np.sin(40 * x) + 0.15 * np.cos(30 * y + 1)
    rgb = np.stack([pattern, 0.7 * pattern, 1 - pattern], -1) + brightness
    alpha = ((np.abs(x) < 0.1) & (np.abs(y) < 0.1)).astype(float)
    return np.concatenate([rgb * alpha[..., None], alpha[..., None]], -1)


@pytest.mark.parametrize(
    ("shifts", "turns"), [((0, 0.004, 0.009), (0, 0, 0)), ((0, 0, 0), (0, 6, 13)), ((0, 0.01, 0), (0, 5, 2))]
)
def test_paint_that_moves_with_the_skin_does_not_differ(shifts, turns):
    views = tuple(plane(shift, turn) for shift, turn in zip(shifts, turns, strict=True))
    images = tuple(painted(view, shift) for view, shift in zip(views, shifts, strict=True))
    found = warped(views, images)
    assert len(found.pixel) > 2000
    assert np.abs(found.before).max() < 1
    assert np.abs(found.flicker).max() < 1
    still = warped((views[1],) * 3, images)
    assert np.abs(still.before).mean() > 2  # a mesh that does not move says so


def test_steady_change_is_no_flicker():
    views = (plane(),) * 3
    steady = warped(views, tuple(painted(views[0], brightness=value) for value in (0.0, 0.02, 0.04)))
    np.testing.assert_allclose(steady.before, 255 * 0.02, atol=1e-6)
    np.testing.assert_allclose(steady.flicker, 0, atol=1e-6)
    flickering = warped(views, tuple(painted(views[0], brightness=value) for value in (0.0, 0.02, 0.0)))
    np.testing.assert_allclose(flickering.flicker, 255 * 0.02, atol=1e-6)


def test_hidden_skin_is_left_out():
    near = plane()
    above = near.vertices * [0.5, 0.5, 1] + [0, 0, 0.05]
    both = MeshView(
        np.concatenate([near.vertices, above]), np.concatenate([near.faces, near.faces + len(above)]), near.camera
    )
    apart = MeshView(np.concatenate([near.vertices, above + np.array([1.0, 0, 0])]), both.faces, near.camera)
    image = painted(near)
    found = warped((apart, both, apart), (image,) * 3)
    shown = both.fronts.face.numpy()[found.pixel]
    assert (shown < len(near.faces)).all()  # the upper square is away in the others
    assert len(found.pixel) < len(warped((apart,) * 3, (image,) * 3).pixel) - 300
    under = warped((both, apart, both), (image,) * 3)
    assert len(under.pixel) == pytest.approx(len(found.pixel), rel=0.1)
