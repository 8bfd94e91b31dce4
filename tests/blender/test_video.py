"""Videos onto hands: keys, lens, the movie behind the hand, one undo; and that a failure changes nothing."""

import importlib.util
from fractions import Fraction
from pathlib import Path

import bpy
import numpy as np
import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.livehand_blender.motion.movie import Movie
from livehand.livehand_blender.rig.hand import RiggedHand
from PIL import Image

PICTURES = Path(__file__).parents[1] / "tracking" / "pictures"


@pytest.fixture(scope="module")
def hands_picture():
    """uint8 [360, 640, 3], a right hand beside a left one."""
    right, left = (np.asarray(Image.open(PICTURES / f"{name}.jpg").convert("RGB")) for name in ("palm", "left"))
    return np.ascontiguousarray(np.concatenate([right[::2, 360:1000:2], left[::2, 100:740:2]], 1))


@pytest.fixture(scope="module")
def movie(hands_picture, tmp_path_factory):
    """Eight frames at 25 a second; the picture moves by 2 px a frame."""
    av = pytest.importorskip("av", reason="PyAV (the extra video) is not installed")
    path = tmp_path_factory.mktemp("movie") / "hands.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 640, 360, "yuv420p"
        for index in range(8):
            picture = np.roll(hands_picture, 2 * index, 1)
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts, frame.time_base = index, Fraction(1, 25)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


@pytest.fixture
def _without_pyav(monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *more: None if name == "av" else find(name, *more))


def keyed_frames(armature):
    curves = armature.animation_data.action.layers[0].strips[0].channelbags[0].fcurves
    return [int(point.co[0]) for point in next(iter(curves)).keyframe_points]


def everything():
    return {name: len(getattr(bpy.data, name)) for name in ("objects", "scenes", "actions", "cameras", "movieclips")}


def test_blenders_own_decoder(movie, hands_picture, tmp_path):
    shown = Movie(movie)
    assert (shown.count, shown.size_px) == (8, (640, 360))
    assert shown.fps == pytest.approx(25)
    assert list(shown.write_frames(tmp_path)) == [8]
    shown.close()
    frames = [np.asarray(Image.open(file).convert("RGB")) for file in sorted(tmp_path.iterdir())]
    assert len(frames) == 8
    for index in (0, 7):
        assert np.abs(frames[index].astype(int) - np.roll(hands_picture, 2 * index, 1)).mean() < 4
    assert len(bpy.data.scenes) == 1


@pytest.mark.slow
@pytest.mark.usefixtures("tracker_networks", "_without_pyav")
def test_both_hands_of_a_video_are_keyed_before_the_movie(movie):
    assert bpy.ops.livehand.import_video(filepath=str(movie), start_frame=11) == {"FINISHED"}
    hands = {hand.side: hand for hand in RiggedHand.all_in(bpy.context.scene)}
    assert set(hands) == {"right", "left"}
    for hand in hands.values():
        assert keyed_frames(hand.armature) == list(range(11, 19))
    scene, lens = bpy.context.scene, bpy.context.scene.camera.data
    assert (scene.render.resolution_x, scene.render.resolution_y, scene.frame_start, scene.frame_end) == (
        640,
        360,
        11,
        18,
    )
    assert scene.render.fps / scene.render.fps_base == pytest.approx(25)
    assert lens.lens == pytest.approx(0.9 * 36)
    assert lens.show_background_images
    assert lens.background_images[0].clip.filepath == str(movie)
    # Seen through that camera, the hands stand where the video shows them.
    from bpy_extras.object_utils import world_to_camera_view

    scene.frame_set(11)
    bpy.context.view_layer.update()
    for side, hand in hands.items():
        bone = hand.armature.pose.bones[f"middle1.{side[0].upper()}"]
        across = world_to_camera_view(scene, scene.camera, hand.armature.matrix_world @ bone.head).x
        assert (0.1 < across < 0.45) if side == "right" else (0.55 < across < 0.95)


@pytest.mark.usefixtures("tracker_networks")
@pytest.mark.parametrize("is_there", [True, False])
def test_a_video_without_a_hand_or_no_video_changes_nothing(movie, tmp_path, is_there):
    av = pytest.importorskip("av")
    path = tmp_path / "a.mp4"
    if is_there:
        with av.open(str(path), "w") as container:
            stream = container.add_stream("libx264", rate=25)
            stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
            for _ in range(3):
                container.mux(
                    stream.encode(av.VideoFrame.from_ndarray(np.zeros((48, 64, 3), np.uint8), format="rgb24"))
                )
            container.mux(stream.encode(None))
    else:
        path.write_text("no video")
    before = everything()
    with pytest.raises(RuntimeError, match="must show a hand, got none in 3 frames" if is_there else "must be a video"):
        bpy.ops.livehand.import_video(filepath=str(path))
    assert everything() == before


def test_text_is_no_movie_for_blender_either(tmp_path):
    (tmp_path / "a.mp4").write_text("no video")
    with pytest.raises(LiveHandError, match="must be a movie that Blender reads"):
        Movie(tmp_path / "a.mp4")
    assert len(bpy.data.scenes) == 1
