"""Folders of pictures and calibration become views whose cameras project as OpenCV would."""

import json

import numpy as np
import pytest
from livehand.backend.person.rig.calibration import numbered_camera, read_rig
from livehand.backend.records.errors import LiveHandError
from PIL import Image

K = np.array([[500.0, 0, 40], [0, 510.0, 30], [0, 0, 1]])


def outer(angle):
    """World to camera: turned about the axis that points down, half a metre away."""
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.eye(4)
    matrix[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    matrix[2, 3] = 0.5
    return matrix


def far(angle):
    """The same, 900 m away."""
    return outer(angle) + np.array([[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 900.0], [0, 0, 0, 0]])


def arrays(count=4):
    each = [{f"int_{k}": K, f"ext_{k}": outer(k * 1.1)} for k in range(count)]
    return {name: value for part in each for name, value in part.items()}


def write(folder, values, names=("00.png", "01.png", "02.png", "03.png"), size=(80, 60)):
    (folder / "img").mkdir()
    for index, name in enumerate(names):
        Image.fromarray(np.full((size[1], size[0], 3), 10 * index, np.uint8)).save(folder / "img" / name)
    (folder / "camera").mkdir()
    np.savez(folder / "camera" / "param.npz", **values)


def test_a_camera_projects_as_opencv_does_half_a_pixel_on():
    point = np.array([0.02, -0.05, 0.03])  # y points down in the files' world
    camera = numbered_camera(arrays(), 1, (80, 60))
    at = K @ (outer(1.1)[:3, :3] @ point + outer(1.1)[:3, 3])
    px, depth = camera.project(np.array([[0.02, 0.03, 0.05]]))  # Z up here: y of the files is -Z
    assert px[0] == pytest.approx(at[:2] / at[2] + 0.5)
    assert depth[0] == pytest.approx(at[2])


def test_the_direction_upwards_may_be_given():
    camera = numbered_camera(arrays() | {"up": np.array([0, 0, 1.0])}, 0, (80, 60))
    assert camera.cam2world == pytest.approx(np.linalg.inv(outer(0)))


def test_a_folder_of_numbered_pictures_is_read_in_order(tmp_path):
    write(tmp_path, arrays())
    views = read_rig(tmp_path)
    assert [view.camera_index for view in views] == [0, 1, 2, 3]
    assert [view.name for view in views] == ["00.png", "01.png", "02.png", "03.png"]
    assert [int(view.rgb[0, 0, 0]) for view in views] == [0, 10, 20, 30]


def test_cameras_may_be_written_as_json(tmp_path):
    write(tmp_path, arrays())
    (tmp_path / "cameras.json").write_text(json.dumps({name: value.tolist() for name, value in arrays().items()}))
    (tmp_path / "camera" / "param.npz").unlink()
    assert len(read_rig(tmp_path)) == 4


@pytest.mark.parametrize(
    ("changed", "fault"),
    [
        ({"int_1": np.array([[500.0, 5, 40], [0, 510, 30], [0, 0, 1]])}, "no skew, got 5 px"),
        ({"ext_2": outer(0.3) * 1.2}, "must be rigid"),
        ({"ext_2": outer(0.3) @ np.diag([-1.0, 1, 1, 1])}, "must be rigid"),
        ({"ext_0": np.full((4, 4), np.nan)}, "must be finite"),
        ({"int_0": np.ones((2, 3))}, r"\[3, 3\] or \[4, 4\], got \[2, 3\]"),
        ({"up": np.zeros(3)}, "up must be a direction"),
        ({"int_7": K, "ext_7": outer(0.1)}, "a picture named 07"),
        ({f"ext_{k}": far(k) for k in range(4)}, "in metres"),
    ],
)
def test_malformed_cameras_are_refused(tmp_path, changed, fault):
    write(tmp_path, arrays() | changed)
    with pytest.raises(LiveHandError, match=fault):
        read_rig(tmp_path)


def test_a_folder_without_cameras_is_refused(tmp_path):
    with pytest.raises(LiveHandError, match="must hold the cameras of its pictures"):
        read_rig(tmp_path)


def test_two_cameras_are_too_few(tmp_path):
    write(tmp_path, arrays(2), names=("00.png", "01.png"))
    with pytest.raises(LiveHandError, match="at least 3 cameras, got 2"):
        read_rig(tmp_path)
