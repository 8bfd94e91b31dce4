"""nerfstudio's transforms.json: axes, intrinsics, poses and splits by value, and what is refused."""

import json

import numpy as np
import pytest
from livehand.backend.capture.capture import load_capture
from livehand.backend.capture.exr import write_exr
from livehand.backend.capture.importers.transforms import read_pose_table, read_transforms
from livehand.backend.capture.importers.transforms_capture import import_transforms
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.errors import LiveHandError
from livehand.backend.system.command import run_commands
from livehand.livehand_blender.cli import COMMANDS
from PIL import Image
from scipy.spatial.transform import Rotation

SIZE = (20, 30)
INTRINSICS = {"fl_x": 41.0, "fl_y": 43.0, "cx": 9.5, "cy": 16.25, "w": 20, "h": 30}
RNG = np.random.default_rng(3)
POSES = {
    "theta": RNG.normal(size=(4, 16, 3)),
    "beta": RNG.normal(size=(4, 10)),
    "transl": RNG.normal(size=(4, 3)),
    "side": np.array(["right"] * 4),
}


def matrix(seed):
    transform = np.eye(4)
    transform[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    transform[:3, 3] = np.random.default_rng(seed).normal(size=3)
    return transform


def write(folder, document=INTRINSICS, poses=POSES, frames=None, mode="RGBA"):
    folder.mkdir(exist_ok=True)
    if frames is None:
        frames = [
            {"file_path": f"{camera}/{pose}.png", "transform_matrix": matrix(camera).tolist(), "pose_index": pose}
            for camera in range(2)
            for pose in range(4)
        ]
    for frame in frames:
        path = folder / frame["file_path"]
        path.parent.mkdir(exist_ok=True)
        Image.new(mode, SIZE, (9, 8, 7, 6)[: len(mode)]).save(path if path.suffix else path.with_suffix(".png"))
    (folder / "transforms.json").write_text(json.dumps({**document, "frames": frames}))
    np.savez(folder / "poses.npz", **poses)
    return folder / "transforms.json", folder / "poses.npz"


def frames_of(folder, metres_per_unit=1.0, **options):
    path, poses = write(folder, **options)
    return read_transforms(path, read_pose_table(poses), metres_per_unit)


def test_points_land_where_opengls_formula_puts_them(tmp_path):
    for frame, seed in zip(frames_of(tmp_path)[::4], range(2), strict=True):
        points = np.array(frame.camera.origin) + 3 * RNG.normal(size=(50, 3))
        x, y, z = np.linalg.inv(matrix(seed))[:3] @ np.c_[points, np.ones(50)].T  # right, up, backward
        expected = np.stack([9.5 + 41 * x / -z, 16.25 - 43 * y / -z], -1)
        pixels, depth = frame.camera.project(points)
        np.testing.assert_allclose(pixels, expected, rtol=1e-9)
        np.testing.assert_allclose(depth, -z, atol=1e-12)


def test_units_scale_the_cameras_place_alone(tmp_path):
    one, other = frames_of(tmp_path)[0].camera, frames_of(tmp_path, metres_per_unit=0.1)[0].camera
    np.testing.assert_allclose(other.origin, 0.1 * one.origin)
    np.testing.assert_array_equal(other.cam2world[:3, :3], one.cam2world[:3, :3])


@pytest.mark.parametrize(
    ("document", "K"),
    [
        (INTRINSICS, [41, 43, 9.5, 16.25]),
        ({"fl_x": 41.0}, [41, 41, 10, 15]),
        ({"camera_angle_x": 2 * np.arctan(0.25)}, [40, 40, 10, 15]),
        ({"camera_angle_x": 2 * np.arctan(0.25), "camera_angle_y": 2 * np.arctan(0.5)}, [40, 30, 10, 15]),
        ({**INTRINSICS, "camera_model": "OPENCV", "k1": 0.0, "p2": 0}, [41, 43, 9.5, 16.25]),
    ],
)
def test_intrinsics_in_every_spelling(tmp_path, document, K):
    camera = frames_of(tmp_path, document=document)[0].camera
    np.testing.assert_allclose(camera.K, [[K[0], 0, K[2]], [0, K[1], K[3]], [0, 0, 1]])
    assert camera.size_px == SIZE


def test_a_frames_own_intrinsics_win(tmp_path):
    frame = {"file_path": "a.png", "transform_matrix": matrix(0)[:3].tolist(), "pose_index": 1, "fl_x": 50, "cy": 11}
    camera = frames_of(tmp_path, frames=[frame])[0].camera
    np.testing.assert_allclose(camera.K, [[50, 0, 9.5], [0, 43, 11], [0, 0, 1]])


def test_poses_are_joined_by_index_by_time_or_because_there_is_one(tmp_path):
    times = {**POSES, "time": np.array([0.0, 0.5, 1.5, 2.0])}
    frame = {"file_path": "a", "transform_matrix": matrix(0).tolist()}
    frames = [{**frame, "time": 1.5}, {**frame, "time": 2, "pose_index": 0}]
    assert [f.pose_index for f in frames_of(tmp_path, poses=times, frames=frames)] == [2, 0]
    only = {"theta": POSES["theta"][:1].reshape(1, 48), "beta": POSES["beta"][0], "transl": POSES["transl"][0]}
    assert frames_of(tmp_path, poses=only, frames=[frame])[0].pose_index == 0
    for bad, message in (
        ({}, "must have a pose_index"),
        ({"time": 0.7}, "must be one of the poses', got 0.7, nearest 0.5"),
    ):
        with pytest.raises(LiveHandError, match=rf"frame a: .*{message}"):
            frames_of(tmp_path, poses=times, frames=[{**frame, **bad}])


def test_a_hands_mean_is_added_to_the_fingers(tmp_path):
    _, path = write(tmp_path)
    mean = RNG.normal(size=(15, 3))
    for index, pose in enumerate(read_pose_table(path, mean).poses):
        np.testing.assert_array_equal(pose.theta[0], POSES["theta"][index, 0])
        np.testing.assert_allclose(pose.theta[1:], POSES["theta"][index, 1:] + mean)


def frame_with(**changes):
    good = {"file_path": "0/0.png", "transform_matrix": matrix(0).tolist(), "pose_index": 0}
    return [good, {k: v for k, v in {**good, **changes}.items() if v is not None}]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"document": {**INTRINSICS, "k1": 0.02}}, "pinhole camera, got PINHOLE {'k1': 0.02}; undistort"),
        ({"document": {**INTRINSICS, "camera_model": "OPENCV_FISHEYE"}}, "pinhole camera, got OPENCV_FISHEYE"),
        ({"document": {"cx": 3.0}}, "'camera_angle_x' is missing"),
        ({"document": {**INTRINSICS, "w": 21}}, r"must be w x h = 21 x 30 px, got \(20, 30\)"),
        ({"document": {**INTRINSICS, "fl_x": float("nan")}}, "finite"),
        ({"frames": frame_with(transform_matrix=None)}, "'transform_matrix' is missing"),
        ({"frames": frame_with(transform_matrix=np.diag([2.0, 2, 2, 1]).tolist())}, "rotation"),
        ({"frames": frame_with(transform_matrix=[[1, 2]])}, r"cam2world must be \[4, 4\]"),
        ({"frames": frame_with(pose_index=4)}, "must name one of 4 poses, got 4"),
        ({"frames": frame_with(pose_index="first")}, "frame 0/0.png: "),
        ({"frames": []}, "frames must not be empty"),
    ],
)
def test_what_cannot_be_used_is_named_and_leaves_nothing(tmp_path, options, message):
    path, poses = write(tmp_path / "source", **options)
    with pytest.raises(LiveHandError, match=message):
        import_transforms(path, read_pose_table(poses), load_default_hand(), tmp_path / "capture")
    assert [place.name for place in tmp_path.iterdir()] == ["source"]


def test_what_is_wrong_in_all_images_is_told_once(tmp_path):
    frames = [{**frame_with()[0], "file_path": f"{k}.png"} for k in range(300)]
    path, poses = write(tmp_path, document={**INTRINSICS, "k1": 0.02}, frames=frames)
    with pytest.raises(LiveHandError, match="pinhole") as caught:
        read_transforms(path, read_pose_table(poses), 1.0)
    assert str(caught.value).count("pinhole") == 1
    assert "frame 0.png and 299 more: " in str(caught.value)


@pytest.mark.parametrize("text", ["", "[]", '{"frames": 3}', '{"frames": [3]}', "[" * 100_000, "\x00"])
def test_other_files_are_errors_of_ours(tmp_path, text):
    path, poses = write(tmp_path)
    path.write_text(text)
    with pytest.raises(LiveHandError, match=r"transforms\.json"):
        read_transforms(path, read_pose_table(poses), 1.0)


@pytest.mark.parametrize(
    "changes",
    [
        {"theta": np.zeros((4, 15, 3))},
        {"beta": np.zeros(9)},
        {"transl": np.full((4, 3), np.inf)},
        {"side": np.array(["up"] * 4)},
        {"time": np.zeros(3)},
        {"theta": np.array([{}], dtype=object)},
    ],
)
def test_malformed_poses_are_errors_of_ours(tmp_path, changes):
    _, path = write(tmp_path, poses={**POSES, **changes})
    with pytest.raises(LiveHandError, match=r"poses\.npz"):
        read_pose_table(path)


def test_missing_images_are_all_named(tmp_path):
    path, poses = write(tmp_path)
    for camera in range(2):
        (tmp_path / f"{camera}/3.png").unlink()
    with pytest.raises(LiveHandError, match=r"has 2 faults:(?s:.*)no image at .*0/3\.png(?s:.*)no image at .*1/3\.png"):
        read_transforms(path, read_pose_table(poses), 1.0)


def test_the_command_writes_a_capture_with_splits_and_masks(tmp_path, capsys):
    path, poses = write(tmp_path / "source", mode="RGB")
    document = json.loads(path.read_text())
    Image.new("L", SIZE, 200).save(path.parent / "mask.png")
    for frame in document["frames"]:
        frame["mask_path"] = "mask.png"
    path.write_text(json.dumps(document))
    arguments = ["import-transforms", str(path), "--poses", str(poses), "-o", str(tmp_path / "capture")]
    held_out = ["--held-out-poses", "1", "3", "--held-out-cameras", "1"]
    assert run_commands("livehand", "", COMMANDS, [*arguments, *held_out, "--json"]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["splits"] == {"train": 2, "novel_pose": 2, "novel_camera": 2, "test": 2}
    capture = load_capture(tmp_path / "capture")
    assert capture.hand_sha256 == load_default_hand().sha256
    np.testing.assert_array_equal(capture.poses[2].theta, POSES["theta"][2])
    for index, view in enumerate(capture.views):
        assert (view.camera_index, view.pose_index) == divmod(index, 4)
        assert capture.read_pixels(view)[3, 3].tolist() == [9, 8, 7, 200]
    assert run_commands("livehand", "", COMMANDS, [*arguments[:-1], str(tmp_path / "b"), "--held-out-poses", "9"]) == 1
    assert "held-out poses must be some, but not all, of 0 to 3, got [9]" in capsys.readouterr().err


def test_the_last_tenth_of_poses_and_every_eighth_camera_are_held_out_by_default(tmp_path):
    poses = {"theta": np.zeros((20, 16, 3)), "beta": np.zeros(10), "transl": np.zeros((20, 3))}
    frames = [
        {"file_path": "0/0.png", "transform_matrix": matrix(camera).tolist(), "pose_index": pose}
        for camera, pose in [*((camera, 0) for camera in range(16)), (0, 17), (0, 18), (0, 19)]
    ]
    path, file = write(tmp_path / "source", poses=poses, frames=frames)
    capture = import_transforms(path, read_pose_table(file), load_default_hand(), tmp_path / "capture")
    assert [view.camera_index for view in capture.of_split("novel_camera")] == [7, 15]
    assert [view.pose_index for view in capture.of_split("novel_pose")] == [18, 19]
    assert len({view.file for view in capture.views}) == len(frames)


def write_lit(folder):
    """Two cameras, three poses, and nine point lamps one at a time and a sky; in other units, some images linear."""
    lamps = [{"lamps": [{"kind": "point", "rgb": [4, 5, 6], "position": [k, 2, 3], "radius_m": 0.5}]} for k in range(9)]
    lamps[2] = {"kind": "studio", "sky_path": "sky.exr", "occluders": [[[1, 2, 3], [4, 5, 6], [7, 8, 9]]]}
    frames = [
        {
            "file_path": f"{camera}/{pose}_{light}.png",
            "transform_matrix": matrix(camera).tolist(),
            "pose_index": pose,
            "light": light,
            "exposure": 0.5,
        }
        for camera in range(2)
        for pose in range(2)
        for light in range(9)
    ]
    frames[0]["light"] = {"lamps": [{"kind": "sun", "rgb": [1, 2, 3]}]}
    paths = write(folder, {**INTRINSICS, "lights": lamps}, frames=frames)
    write_exr(folder / "sky.exr", dict.fromkeys("RGB", np.full((4, 8), 2.5, np.float16)))
    write_exr(folder / "linear.exr", dict.fromkeys("RGBA", np.full(SIZE[::-1], 0.5, np.float16)))
    document = json.loads(paths[0].read_text())
    document["frames"][1]["file_path"] = "linear"
    paths[0].write_text(json.dumps(document))
    return paths


def test_lights_of_frames_become_the_captures(tmp_path):
    path, poses = write_lit(tmp_path / "scene")
    import_transforms(path, read_pose_table(poses), load_default_hand(), tmp_path / "out", 0.1, [], [], [3])
    capture = load_capture(tmp_path / "out")
    assert len(capture.lights) == 10
    sun, lamp, studio, third = (capture.lights[capture.views[index].light] for index in (0, 1, 2, 3))
    assert sun.light.lamps[0].rgb.tolist() == [1, 2, 3]
    (point,) = lamp.light.lamps
    np.testing.assert_allclose(point.position, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(point.rgb, [0.04, 0.05, 0.06])  # as bright on a hand that is ten times as near
    assert point.radius_m == pytest.approx(0.05)
    assert studio.kind == "studio"
    assert (studio.light.sky.radiance == 2.5).all()
    np.testing.assert_allclose(studio.light.occluders, 0.1 * np.arange(1, 10).reshape(1, 3, 3))
    assert {view.exposure for view in capture.views} == {0.5}
    np.testing.assert_allclose(capture.read_linear(capture.views[1])[..., :3], 1.0)
    novel = {view.light for view in capture.of_split("novel_light")}
    assert novel == {3}
    assert third is capture.lights[3]
    assert 3 not in {view.light for view in capture.of_split("train")}


def test_every_eighth_light_is_held_out_by_default(tmp_path):
    path, poses = write_lit(tmp_path / "scene")
    arguments = [path, "--poses", poses, "-o", tmp_path / "out", "--held-out-cameras"]
    assert run_commands("livehand", "", COMMANDS, ["import-transforms", *map(str, arguments)]) == 0
    assert {view.light for view in load_capture(tmp_path / "out").of_split("novel_light")} == {7}


@pytest.mark.parametrize(
    ("light", "message"),
    [
        (9, "light must be an index of lights, got 9"),
        (-1, "light must be an index of lights, got -1"),
        (True, "light must be an object"),
        ("studio", "light must be an object"),
        ({"lamps": [{"kind": "point"}]}, "light: a lamp must have a kind and rgb"),
        ({"sky_path": "none.exr"}, "none.exr must be a readable image"),
    ],
)
def test_bad_lights_are_named(tmp_path, light, message):
    path, poses = write_lit(tmp_path / "scene")
    document = json.loads(path.read_text())
    document["frames"][4]["light"] = light
    path.write_text(json.dumps(document))
    with pytest.raises(LiveHandError, match=rf"frame 0/0_4\.png: .*{message}"):
        import_transforms(path, read_pose_table(poses), load_default_hand(), tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["file_path", "mask_path"])
@pytest.mark.parametrize("place", ["../secret.png", "{outside}", "link/secret.png"])
def test_files_outside_the_folder_are_not_copied_unless_allowed(tmp_path, name, place):
    secret = tmp_path / "secret.png"
    path, poses = write(tmp_path / "source")
    Image.new("RGBA", SIZE).save(secret)
    (tmp_path / "source" / "link").symlink_to(tmp_path)
    document = json.loads(path.read_text())
    document["frames"][3][name] = place.format(outside=secret)
    path.write_text(json.dumps(document))
    asked = path, read_pose_table(poses), load_default_hand(), tmp_path / "capture"
    with pytest.raises(LiveHandError, match=r"must lie inside .*--allow-outside"):
        import_transforms(*asked)
    assert not list(tmp_path.glob("capture*"))
    capture = import_transforms(*asked, allows_outside=True)
    assert len(capture.views) == 8


def test_masks_are_images_before_anything_is_copied(tmp_path):
    path, poses = write(tmp_path / "source")
    source = json.loads(path.read_text())
    (tmp_path / "source" / "notes.png").write_text("root:x:0:0")
    Image.new("L", (9, 9)).save(tmp_path / "source" / "small.png")
    (tmp_path / "source" / "zero.png").symlink_to("/dev/zero")

    def refused(mask, message, **options):
        source["frames"][0]["mask_path"] = mask
        path.write_text(json.dumps(source))
        with pytest.raises(LiveHandError, match=message):
            import_transforms(path, read_pose_table(poses), load_default_hand(), tmp_path / "capture", **options)
        assert not list(tmp_path.glob("capture*"))

    refused("notes.png", "readable image")
    refused("small.png", "like its camera")
    refused("zero.png", "must lie inside")
    refused("zero.png", "pipe, socket or device", allows_outside=True)
    refused("a\0b", "must be text")
    refused("x" * 300, "must be")
    refused(7, "must be text")


@pytest.mark.parametrize("angle", [0, -1, 4])
def test_a_camera_without_an_angle_is_named(tmp_path, angle):
    path, poses = write(tmp_path / "source", document={"camera_angle_x": angle})
    with pytest.raises(LiveHandError, match="angle must lie between"):
        read_transforms(path, read_pose_table(poses), 1.0)
