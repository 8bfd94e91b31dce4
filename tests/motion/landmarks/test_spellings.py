"""Landmarks in every published spelling: MediaPipe's Tasks and solutions in Python and JavaScript, WebXR, tables."""

import csv
import json
import pickle

import numpy as np
import pytest
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.lbs import posed_arrays
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.files.open_files import open_motion_file
from livehand.backend.motion.landmarks.fit import palm_m
from livehand.backend.motion.landmarks.joint_names import read_joint_name, words
from livehand.backend.motion.landmarks.picture_camera import PictureCamera, lifted
from livehand.backend.motion.landmarks.skeleton import NODES_OF_LANDMARKS, HandSkeleton, _finger_rows
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose

pytestmark = pytest.mark.slow

HAND = load_default_hand()
TIPS = [int(np.argmax(_finger_rows(HAND, finger)[3])) for finger in range(5)]
FINGERS = ("thumb", "index_finger", "middle_finger", "ring_finger", "pinky")
NAMES = [
    "wrist",
    *("thumb_cmc", "thumb_mcp", "thumb_ip", "thumb_tip"),
    *(f"{finger}_{joint}" for finger in FINGERS[1:] for joint in ("mcp", "pip", "dip", "tip")),
]
WEBXR = [
    "wrist",
    *(f"thumb-{joint}" for joint in ("metacarpal", "phalanx-proximal", "phalanx-distal", "tip")),
    *(
        f"{finger}-finger-{joint}"
        for finger in ("index", "middle", "ring", "pinky")
        for joint in ("metacarpal", "phalanx-proximal", "phalanx-intermediate", "phalanx-distal", "tip")
    ),
]


def landmarks(gesture, side="right"):
    """[21, 3] m about the hand's centre, in OpenCV's axes."""
    theta = theta_of(GESTURES[gesture].angles_deg(), FingerAxes.of_default_hand(), np.array([0.3, 0.5, -0.2]))
    vertices, joints = posed_arrays(HAND, HandPose(theta, np.zeros(10), np.zeros(3)))
    fingers = (np.r_[joints[3 * k + 1 : 3 * k + 4], vertices[TIPS[k]][None]] for k in range(5))
    points = np.concatenate([joints[:1], *fingers])[list(NODES_OF_LANDMARKS)]
    points = (points - points.mean(0)) * ([1, 1, 1] if side == "right" else [-1, 1, 1])
    return points.round(6)


RIGHT = np.array([landmarks(name) for name in ("relaxed", "fist", "point")])
LEFT = np.array([landmarks(name, "left") for name in ("relaxed", "fist", "point")])
PICTURE = (RIGHT - RIGHT[:, :1]) * 2 + [0.5, 0.6, 0]


def named(points, **more):
    return [dict(zip("xyz", point, strict=True), **more) for point in points.tolist()]


def categories(*labels, name="categoryName"):
    return [[{"score": 0.9, "index": 0, name: label, "displayName": label}] for label in labels]


def opened(tmp_path, content, name="take.json"):
    path = tmp_path / name
    if name.endswith(".pkl"):
        path.write_bytes(pickle.dumps(content))
    else:
        path.write_text(content if isinstance(content, str) else json.dumps(content))
    return open_motion_file(path)


def javascript_tasks(index):
    return {
        "landmarks": [named(PICTURE[index], visibility=0)],
        "worldLandmarks": [named(RIGHT[index], visibility=0)],
        "handedness": categories("Right"),
        "handednesses": categories("Right"),
    }


def python_tasks(index):
    return {
        "handedness": categories("Right", name="category_name"),
        "hand_landmarks": [named(PICTURE[index], presence=0.0)],
        "hand_world_landmarks": [named(RIGHT[index], presence=0.0)],
    }


def python_solution(index):
    return {
        "multi_hand_landmarks": [{"landmark": named(PICTURE[index])}],
        "multi_hand_world_landmarks": [{"landmark": named(RIGHT[index])}],
        "multi_handedness": [{"classification": [{"index": 1, "score": 0.98, "label": "Left"}]}],
    }


def javascript_solution(index):
    return {
        "multiHandLandmarks": [named(PICTURE[index])],
        "multiHandWorldLandmarks": [named(RIGHT[index])],
        "multiHandedness": [{"index": 0, "score": 0.98, "label": "Left"}],
    }


def tensorflow(index):
    points3d = [{"name": name, **point} for name, point in zip(NAMES, named(RIGHT[index]), strict=True)]
    points = [{"x": 600.0, "y": 400.0, "name": name} for name in NAMES]
    return [{"score": 0.97, "handedness": "Left", "keypoints": points, "keypoints3D": points3d}]


@pytest.mark.parametrize(
    "result",
    [javascript_tasks, python_tasks, python_solution, javascript_solution, tensorflow],
    ids=lambda f: f.__name__,
)
def test_world_landmarks_are_read_from_every_spelling(tmp_path, result):
    file = opened(tmp_path, [result(0), None, result(1), result(2)])
    np.testing.assert_allclose(file.points, RIGHT)
    np.testing.assert_array_equal(file.frame_indices, [0, 2, 3])
    assert (file.info.format, file.info.side, file.info.space) == ("MediaPipe landmarks", "right", "opencv")
    assert (file.info.frames, file.info.missing) == (4, 1)


@pytest.mark.parametrize("layout", ["frames", "by number", "with numbers"])
def test_layouts_of_frames(tmp_path, layout):
    results = [javascript_tasks(0), None, javascript_tasks(1), javascript_tasks(2)]
    if layout == "frames":
        content = {"fps": 24, "frames": results}
    elif layout == "by number":
        content = {str(100 + number): one for number, one in enumerate(results)}
    else:
        content = [{"frame": 7 + number, "hands": one} for number, one in enumerate(results) if one]
    file = opened(tmp_path, content)
    np.testing.assert_allclose(file.points, RIGHT)
    np.testing.assert_array_equal(file.frame_indices - file.frame_indices[0], [0, 2, 3])
    assert file.info.fps == (24 if layout == "frames" else None)
    assert file.fit(HAND).rms_m < 0.003


def test_one_result_is_one_frame(tmp_path):
    for result in (javascript_tasks, python_tasks, python_solution, javascript_solution):
        np.testing.assert_allclose(opened(tmp_path, result(1)).points, RIGHT[1:2])


def test_the_bend_decides_where_versions_differ_on_the_label(tmp_path):
    for label in ("Left", "Right"):
        for points, side in ((RIGHT, "right"), (LEFT, "left")):
            file = opened(tmp_path, {"world_landmarks": points.tolist(), "handedness": label})
            assert file.info.side == side
            assert file.warning(HAND) is None
            assert bool(file.info.notes) == (label.lower() != side)
    assert opened(tmp_path, LEFT.tolist()).info.side == "left"


def test_picture_landmarks_are_refused_without_a_camera(tmp_path):
    alone = [
        {"landmarks": [named(points)], "handedness": categories("Right")} for points in PICTURE
    ]  # as JavaScript writes them
    for content in (
        alone,
        [{"multiHandLandmarks": [named(points)]} for points in PICTURE],
        [{"hand_landmarks": [named(points)]} for points in PICTURE],
        {"landmarks": PICTURE.tolist(), "handedness": "Left"},
        PICTURE.tolist(),
    ):
        file = opened(tmp_path, content)
        assert file.info.format == "MediaPipe picture landmarks"
        assert "not metres" in " ".join(file.info.notes)
        with pytest.raises(LiveHandError, match=r"must hold world landmarks .*state the picture's size"):
            file.motion(HAND)
        with pytest.raises(LiveHandError, match="image coordinates, px"):
            file.with_changes(unit="cm").fit(HAND)


def test_a_camera_makes_places_of_picture_landmarks(tmp_path):
    camera = PictureCamera((1280, 720), 60.0)
    true = RIGHT + np.array([0.05, -0.02, 0.6])
    shown_px = true[..., :2] / true[..., 2:] * camera.focal_px + np.array(camera.size_px) / 2
    depth_px = (true[..., 2] - true[:, :1, 2]) * camera.focal_px / true[:, :1, 2]
    picture = np.concatenate([shown_px / camera.size_px, depth_px[..., None] / 1280], -1)
    np.testing.assert_allclose(lifted(picture, camera, palm_m(HAND)).mean(1), true.mean(1), atol=0.06)
    file = opened(tmp_path, {"landmarks": picture.tolist()}).with_changes(picture_camera=camera, side="right")
    assert file.info.has_translation
    fit = file.fit(HAND)
    assert fit.rms_m < 0.006
    wrist = fit.motion.transl + HandSkeleton.of(HAND).rest[0]
    np.testing.assert_allclose(wrist, true[:, 0], atol=0.06)
    for wrong in ((0, 720), (1280, 720)):
        with pytest.raises(LiveHandError, match="angle of view"):
            PictureCamera(wrong, 60.0 if wrong[0] == 0 else 200.0)


def test_a_list_of_arrays_in_a_pickle(tmp_path):
    file = opened(tmp_path, [RIGHT[0], None, RIGHT[1].astype(np.float32), RIGHT[2]], "take.pkl")
    np.testing.assert_allclose(file.points, RIGHT, atol=1e-7)
    np.testing.assert_array_equal(file.frame_indices, [0, 2, 3])


def webxr(points):
    values = {
        name: point for name, point in zip([n for n in WEBXR if "finger-metacarpal" not in n], points, strict=True)
    }
    return {name: values.get(name, np.full(3, 9.0)).tolist() for name in WEBXR}


@pytest.mark.parametrize("form", ["numbers", "positions", "transforms", "list"])
def test_joints_by_their_names_in_webxr(tmp_path, form):
    def joints(points):
        named_points = {name: dict(zip("xyz", point, strict=True)) for name, point in webxr(points).items()}
        if form == "numbers":
            return webxr(points)
        if form == "positions":
            return {name: {"position": point, "radius": 0.01} for name, point in named_points.items()}
        if form == "transforms":
            return {name: {"transform": {"position": point}} for name, point in named_points.items()}
        return [{"joint": name, "position": point} for name, point in reversed(named_points.items())]

    for content in (
        [{"handedness": "left", "joints": joints(points)} for points in LEFT],
        [{"left": joints(points)} for points in LEFT],
        {"frames": [{"inputSources": [{"handedness": "left", "hand": joints(points)}]} for points in LEFT]},
    ):
        file = opened(tmp_path, content)
        np.testing.assert_allclose(file.points, LEFT)
        assert (file.info.format, file.info.space, file.info.side) == ("WebXR joints", "y_up", "left")


@pytest.mark.parametrize(
    ("name", "landmark"),
    [
        ("WRIST", 0),
        ("INDEX_FINGER_MCP", 5),
        ("thumb-phalanx-distal", 3),
        ("XR_HAND_JOINT_LITTLE_INTERMEDIATE_EXT", 18),
        ("indexFingerIntermediateTip", 7),
        ("thumbIntermediateBase", 2),
        ("RingProximal", 13),
        ("littlePIP", 18),
        ("thumbMP", 2),
    ],
)
def test_names_of_joints(name, landmark):
    assert read_joint_name(words(name)).landmark == landmark


def test_other_words_name_no_joint():
    assert read_joint_name(words("index-finger-metacarpal")).landmark is None
    for name in ("index_finger_tip_velocity", "elbow", "thumb", "tip", "left", ""):
        assert read_joint_name(words(name)) is None


def table(header, rows, separator=","):
    return "\n".join(separator.join(map(str, row)) for row in [header, *rows])


@pytest.mark.parametrize("pattern", ["{joint}_{axis}", "{axis}_{joint}", "{joint}.{axis}", "{JOINT}_{AXIS}"])
def test_columns_by_joint(tmp_path, pattern):
    header = [
        pattern.format(joint=name, axis=axis, JOINT=name.upper(), AXIS=axis.upper()) for name in NAMES for axis in "xyz"
    ]
    file = opened(tmp_path, table(header, RIGHT.reshape(3, 63)), "take.csv")
    np.testing.assert_allclose(file.points, RIGHT)
    assert file.info.format == "MediaPipe landmarks"


def test_both_hands_in_columns(tmp_path):
    header = ["frame"] + [f"{side}_{name}_{axis}" for side in ("left", "right") for name in NAMES for axis in "xyz"]
    rows = [[n, *left.ravel(), *right.ravel()] for n, left, right in zip((4, 5, 7), LEFT, RIGHT, strict=True)]
    file = opened(tmp_path, table(header, rows), "take.csv")
    assert file.sides == ("right", "left")
    np.testing.assert_allclose(file.points, RIGHT)
    left = file.with_changes(side="left")
    np.testing.assert_allclose(left.points, LEFT)
    np.testing.assert_array_equal(left.frame_indices, [0, 1, 3])


@pytest.mark.parametrize("by_name", [False, True])
@pytest.mark.parametrize("is_world", [False, True])
def test_long_tables(tmp_path, by_name, is_world):
    header = ["frame", "handedness", "landmark", "x", "y", "z"] + (
        ["world_x", "world_y", "world_z"] if is_world else []
    )
    rows = []
    for frame, points, picture in zip((10, 11, 13), RIGHT, PICTURE, strict=True):
        for index, (point, place) in enumerate(zip(points, picture, strict=True)):
            values = [*place, *point] if is_world else point
            rows.append([frame, "Left", NAMES[index].upper() if by_name else index, *values])
    rng = np.random.default_rng(0)
    file = opened(tmp_path, table(header, [rows[k] for k in rng.permutation(len(rows))]), "take.csv")
    np.testing.assert_allclose(file.points, RIGHT)
    np.testing.assert_array_equal(file.frame_indices, [0, 1, 3])
    assert file.info.side == "right"


def test_long_tables_of_a_whole_body_give_its_hands(tmp_path):
    rows = [[0, kind, k, 0.1 * k, 0.2, 0] for kind, count in (("face", 30), ("pose", 33)) for k in range(count)]
    for frame in range(3):
        for kind, points in (("left_hand", LEFT[frame]), ("right_hand", RIGHT[frame])):
            rows += [[frame, kind, k, *point] for k, point in enumerate(points)]
    file = opened(tmp_path, table(["frame", "type", "landmark_index", "x", "y", "z"], rows), "take.csv")
    np.testing.assert_allclose(file.points, RIGHT)
    np.testing.assert_allclose(file.with_changes(side="left").points, LEFT)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_table_without_a_header(tmp_path, separator):
    rows = [separator.join(str(value) for value in points.ravel()) for points in RIGHT]
    text = "\n".join([rows[0], separator * 62, *rows[1:]])
    text = text.replace(".", ",") if separator == ";" else text
    file = opened(tmp_path, text, "take.csv")
    np.testing.assert_allclose(file.points, RIGHT)
    np.testing.assert_array_equal(file.frame_indices, [0, 2, 3])


def test_two_hands_in_one_file(tmp_path):
    both = [
        {
            "worldLandmarks": [named(left), named(right)],
            "landmarks": [named(PICTURE[0]), named(PICTURE[1])],
            "handedness": categories("Left", "Right"),
        }
        for left, right in zip(LEFT, RIGHT, strict=True)
    ]
    by_row = [
        {"frame": frame, "handedness": side, "world_landmarks": points[frame].tolist()}
        for frame in range(3)
        for side, points in (("Left", LEFT), ("Right", RIGHT))
    ]
    by_side = [
        {"left_hand": left.tolist(), "right_hand": right.tolist()} for left, right in zip(LEFT, RIGHT, strict=True)
    ]
    for content in (both, by_row, by_side, {"left": LEFT.tolist(), "right": RIGHT.tolist()}):
        file = opened(tmp_path, content)
        assert file.sides == ("right", "left")
        np.testing.assert_allclose(file.points, RIGHT)
        np.testing.assert_allclose(file.with_changes(side="left").points, LEFT)
        assert file.with_changes(side="left").motion(HAND).side == "left"


def test_two_hands_without_labels_are_refused(tmp_path):
    with pytest.raises(LiveHandError, match=r"(?s)must label each .*null,\n"):
        opened(tmp_path, [{"worldLandmarks": [named(LEFT[0]), named(RIGHT[0])]}])


def test_a_flickering_label_is_one_hand(tmp_path):
    frames = [
        {"handedness": "Left" if k == 4 else "Right", "world_landmarks": RIGHT[k % 3].tolist()} for k in range(12)
    ]
    file = opened(tmp_path, frames)
    assert (file.sides, len(file.points)) == (("right",), 12)
    assert "1 frames are labelled as the other hand" in file.info.notes[-1]


def test_a_frame_that_lacks_a_landmark_is_told(tmp_path):
    frames = [{"handedness": "Right", "world_landmarks": RIGHT[k % 3].tolist()} for k in range(6)]
    for number in (2, 4):
        frames[number]["world_landmarks"][7] = [float("nan")] * 3
    file = opened(tmp_path, frames)
    assert file.frame_indices.tolist() == [0, 1, 3, 5]
    words = "2 frames lack some landmarks (NaN) and count as frames without a hand: 2, 4"
    assert words in file.warning(load_default_hand())
    assert "lack" not in str(opened(tmp_path, frames[:2]).warning(load_default_hand()))


def test_of_two_hands_with_one_label_the_surer_is_read(tmp_path):
    result = {
        "worldLandmarks": [named(LEFT[0]), named(RIGHT[0])],
        "handedness": [[{"score": score, "categoryName": "Right"}] for score in (0.6, 0.9)],
    }
    file = opened(tmp_path, [result, python_tasks(1)])
    np.testing.assert_allclose(file.points, RIGHT[:2])
    assert "share a label" in " ".join(file.info.notes)


@pytest.mark.parametrize(
    "content",
    [
        [[[0.1, 0.2]] * 21],
        [named(RIGHT[0])[:20]],
        [RIGHT[0].tolist(), RIGHT[1].tolist()[:-1]],
        {"frames": [{"hand": "?"}]},
        {"something": 1},
        [],
    ],
)
def test_a_refusal_shows_what_a_landmark_file_looks_like(tmp_path, content):
    with pytest.raises(LiveHandError) as refusal:
        opened(tmp_path, content)
    example = str(refusal.value).partition('{"fps"')[2]
    assert example.count("\n") == 3
    assert "world_landmarks" in example


def test_tables_that_lack_a_landmark_are_refused(tmp_path):
    header = [f"{name}_{axis}" for name in NAMES[:-1] for axis in "xyz"]
    with pytest.raises(LiveHandError, match="x, y and z of 21 landmarks, got 60"):
        opened(tmp_path, table(header, RIGHT[:, :20].reshape(3, 60)), "take.csv")
    with pytest.raises(LiveHandError, match="must have a column 'frame'"):
        opened(tmp_path, table(["landmark", "x", "y", "z"], [[k, *RIGHT[0, k]] for k in range(21)]), "take.csv")


def test_the_example_of_the_refusal_is_a_file_that_is_read(tmp_path):
    """With all 21 points in place of the dots."""
    from livehand.backend.motion.landmarks.recording import EXAMPLE

    text = "{" + EXAMPLE.partition("{")[2]
    rest = json.dumps(RIGHT[0, 2:].tolist())[1:-1]
    file = opened(tmp_path, text.replace("...", rest))
    assert (len(file.points), file.info.fps, file.info.missing) == (2, 30, 1)


def test_quoted_cells(tmp_path):
    path = tmp_path / "take.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file, quoting=csv.QUOTE_ALL)
        writer.writerow([f"{name}_{axis}" for name in NAMES for axis in "xyz"])
        writer.writerows(RIGHT.reshape(3, 63).tolist())
    np.testing.assert_allclose(open_motion_file(path).points, RIGHT)


# Layouts of files that others have published: a recorder for musicians, a bridge between programs, a WebXR emulator.
def test_a_list_of_named_hands_with_their_frames(tmp_path):
    def frames(points):
        pictures = (points * 4 + 0.5).round(6)
        return [
            {"timestamp": 33 * k, "normalizedPositions": named(pictures[k]), "worldPositions": named(points[k])}
            for k in range(3)
        ]

    takes = [{"name": "Left", "animationData": frames(LEFT)}, {"name": "Right", "animationData": frames(RIGHT)}]
    file = opened(tmp_path, takes)
    assert file.sides == ("right", "left")
    np.testing.assert_allclose(file.points, RIGHT, atol=1e-9)
    np.testing.assert_allclose(file.with_changes(side="left").points, LEFT, atol=1e-9)
    by_side = opened(tmp_path, {take["name"]: take["animationData"] for take in takes})
    np.testing.assert_allclose(by_side.points, RIGHT, atol=1e-9)
    (one,) = takes[1:]
    np.testing.assert_allclose(opened(tmp_path, [{"name": "Left", "animationData": []}, one]).points, RIGHT, atol=1e-9)


def test_a_frame_on_each_line(tmp_path):
    frames = [{"hands": [{"side": "Right", "world_landmarks": named(points)}], "timestamp_ms": 33} for points in RIGHT]
    file = opened(tmp_path, "\n".join(map(json.dumps, frames)) + "\n", "take.jsonl")
    np.testing.assert_allclose(file.points, RIGHT, atol=1e-9)
    with pytest.raises(LiveHandError, match=r"take.jsonl: line 2 must be well-formed JSON"):
        opened(tmp_path, json.dumps(frames[0]) + "\n{", "take.jsonl")


def test_an_emulators_joint_transforms(tmp_path):
    def matrix(point):
        return [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, *point.tolist(), 1]

    joints = np.zeros((25, 3))
    joints[[k for k, name in enumerate(WEBXR) if k == 0 or "metacarpal" not in name or "thumb" in name]] = RIGHT[0]
    pose = {name: {"offsetMatrix": matrix(joints[k]), "radius": 0.01} for k, name in enumerate(WEBXR)}
    file = opened(tmp_path, {"jointTransforms": pose, "gripOffsetMatrix": matrix(np.zeros(3))})
    assert file.info.format == "WebXR joints"
    np.testing.assert_allclose(file.points, RIGHT[:1], atol=1e-9)


def test_a_refused_array_is_named_by_its_shape(tmp_path):
    np.save(tmp_path / "holistic.npy", np.zeros(1692))
    with pytest.raises(LiveHandError, match=r"got an array \[1692\]"):
        open_motion_file(tmp_path / "holistic.npy")
