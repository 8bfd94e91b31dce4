"""The fade towards the cut end: against the places of the surface, on the built-in hand's stump and on an arm."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.arm_end import distance_from_end_m
from livehand.backend.hand.bones import rest_bones, rest_forearm
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.frame import DEPTH_BACKGROUND, Frame
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.render.composition import joined, visible_parts
from livehand.backend.render.frame_task import HandTask
from livehand.backend.render.surface_maps import surface_maps
from livehand.backend.render.wrist_fade import faded

SIZE = (60, 70)
FADE_M = 0.04


def shot_of(model, pose, fade_m=FADE_M):
    centre = model.for_side(pose.side).v_template.mean(0)
    cam2world = look_at(centre + np.array([0.05, 0.45, 0.1]), centre, np.array([0.0, 0, 1]))
    K = np.array([[110.0, 0, 30], [0, 110, 35], [0, 0, 1]])
    return Shot(pose, posed_vertices(model, pose), Camera(K, cam2world, SIZE), wrist_fade_m=fade_m)


def frame_of(shot, model):
    """An opaque, even frame of the mesh, one pixel wider all around."""
    maps = surface_maps(shot, model)
    inside = np.pad(maps.depth < DEPTH_BACKGROUND, 1)
    wide = np.any([np.roll(inside, shift, (0, 1)) for shift in np.ndindex(3, 3)], 0)[2:, 2:]
    alpha = wide.astype(np.float32)
    return Frame(alpha[..., None] * np.float32((1.0, 0.5, 0.25)), alpha, maps.depth), maps


def smooth_step(x):
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)


@pytest.fixture(scope="session")
def hand(hand_without_arm):
    """The built-in hand that ends in a stump."""
    return hand_without_arm


@pytest.fixture
def armed(hand):
    """The built-in hand whose stump turns as a forearm."""
    return replace(hand, arm_weights=hand.lbs_weights[:, 0] * (hand.v_template[:, 0] > hand.joints[0, 0]))


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_stump_fades_by_the_distance_of_its_surface_from_the_end(hand, side):
    shot = shot_of(hand, HandPose.rest(side))
    frame, maps = frame_of(shot, hand)
    result = faded(frame, shot, hand)
    model = hand.for_side(side)
    along = rest_bones(model).frames[0][:, 1]
    on_mesh = maps.depth < DEPTH_BACKGROUND
    distance_m = maps.position[on_mesh] @ along - (model.v_template @ along).min()
    share = smooth_step(distance_m / FADE_M)
    assert share.min() < 0.1
    np.testing.assert_allclose(result.alpha[on_mesh], share, atol=1e-4)
    np.testing.assert_allclose(result.rgb[on_mesh], share[:, None] * (1.0, 0.5, 0.25), atol=1e-4)
    hidden = result.alpha < 0.5
    assert (result.depth[hidden] == DEPTH_BACKGROUND).all()
    np.testing.assert_array_equal(result.depth[~hidden], frame.depth[~hidden])


@pytest.mark.parametrize("fade_m", [0.0, FADE_M])
def test_the_fade_of_the_surface_is_that_of_the_frame(hand, fade_m):
    shot = shot_of(hand, HandPose.rest("right"), fade_m)
    frame, maps = frame_of(shot, hand)
    on_mesh = maps.depth < DEPTH_BACKGROUND
    np.testing.assert_allclose(maps.fade[on_mesh, 0], faded(frame, shot, hand).alpha[on_mesh], atol=0.02)
    assert (maps.fade[on_mesh].min() < 0.1) == (fade_m > 0)
    assert maps.fade[~on_mesh].max() == 0


def test_pixels_beside_the_mesh_fade_with_those_next_to_them(hand):
    shot = shot_of(hand, HandPose.rest("right"))
    frame, maps = frame_of(shot, hand)
    beside = (frame.alpha > 0) & (maps.depth == DEPTH_BACKGROUND)
    alpha = faded(frame, shot, hand).alpha
    rows, columns = np.nonzero(beside)
    around = [
        (alpha[y - 1 : y + 2, x - 1 : x + 2], ~beside[y - 1 : y + 2, x - 1 : x + 2])
        for y, x in zip(rows, columns, strict=True)
    ]
    for (y, x), (near, other) in zip(zip(rows, columns, strict=True), around, strict=True):
        near = near[other & (near > 0)]
        assert near.size == 0 or near.min() - 0.05 <= alpha[y, x] <= near.max() + 0.05


def test_an_arm_fades_along_itself_however_it_is_turned(armed):
    pose = replace(HandPose.rest("right"), forearm=np.array([0.1, 0.5, -0.2]))
    shot = shot_of(armed, pose)
    frame, maps = frame_of(shot, armed)
    wrist, along = armed.joints[0], rest_forearm(armed).frame[:, 1]
    at_rest = wrist + (maps.position - wrist) @ axis_angle_to_matrix(pose.forearm)
    distance_m = at_rest @ along - (armed.v_template @ along).min()
    is_arm = (maps.depth < DEPTH_BACKGROUND) & (distance_m < 0.012)
    assert is_arm.sum() > 15
    result = faded(frame, shot, armed)
    np.testing.assert_allclose(result.alpha[is_arm], smooth_step(distance_m[is_arm] / FADE_M), atol=1e-3)


def test_the_distance_is_zero_at_the_end_and_does_not_depend_on_the_side(hand):
    distances = distance_from_end_m(hand)
    assert distances.min() == 0
    assert distances.max() == pytest.approx(np.ptp(hand.v_template[:, 0]), rel=0.1)
    np.testing.assert_allclose(distance_from_end_m(hand.for_side("left")), distances, atol=1e-12)


def test_what_is_behind_shows_through_the_fade(hand):
    shot = shot_of(hand, HandPose.rest("right"))
    frame, maps = frame_of(shot, hand)
    front = faded(frame, shot, hand)
    ones = np.ones(SIZE[::-1], np.float32)
    blue = Frame(ones[..., None] * np.float32((0, 0, 1.0)), ones, 2 * ones)
    whole = joined(visible_parts([front, blue]))
    inner = np.s_[::2, ::2]
    middle = (front.alpha > 0.2) & (front.alpha < 0.8) & (maps.depth < DEPTH_BACKGROUND)
    assert middle[inner].sum() > 10
    expected = front.rgb + (1 - front.alpha[..., None]) * np.float32((0, 0, 1))
    np.testing.assert_allclose(whole.alpha[middle], 1, atol=0.1)
    assert np.abs(whole.rgb - expected)[middle].mean() < 0.03


def test_a_view_without_the_end_and_one_from_within_are_no_trouble(hand):
    shot = shot_of(hand, HandPose.rest("right"))
    frame, _ = frame_of(shot, hand)
    moved = np.eye(4)
    moved[:3, 3] = (-10.0, 0, 0)
    beside = replace(shot, camera=replace(shot.camera, cam2world=moved @ shot.camera.cam2world))
    np.testing.assert_array_equal(faded(frame, beside, hand).alpha, frame.alpha)
    inside = shot.camera.cam2world.copy()
    inside[:3, 3] = hand.v_template[hand.v_template[:, 0].argmax()] - [0.001, 0, 0]
    within = replace(shot, camera=replace(shot.camera, cam2world=inside))
    assert np.isfinite(faded(frame, within, hand).alpha).all()


def test_without_a_fade_the_frame_is_the_same_and_a_task_fades_it_otherwise(hand):
    shot = shot_of(hand, HandPose.rest("right"), 0.0)
    frame, _ = frame_of(shot, hand)
    assert faded(frame, shot, hand) is frame

    class Still:
        avatar, is_relightable, mean_albedo, frames_at_once = None, False, None, 1
        renders_at_once = False

        def __init__(self):
            self.hand = hand

        def posed_surface(self, shot):
            return None

        def render(self, shot, should_stop):
            return frame

    assert HandTask(Still(), shot).run(lambda: False) is frame
    task = HandTask(Still(), replace(shot, wrist_fade_m=FADE_M))
    assert task.run(lambda: False).alpha.sum() < 0.97 * frame.alpha.sum()
    assert not task.is_same_as(HandTask(task.renderer, shot))
    with pytest.raises(LiveHandError, match="0 or more"):
        replace(shot, wrist_fade_m=-0.1)
