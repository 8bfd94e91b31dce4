"""The script in docs/make/captures.md runs, and writes the capture that it says."""

import re
import shutil
from pathlib import Path

import numpy as np
from livehand.backend.capture.capture import load_capture

PAGE = Path(__file__).parents[2] / "docs/make/captures.md"


def test_the_pages_script_writes_a_capture(painted_capture, tmp_path, monkeypatch):
    views, poses = painted_capture.views, painted_capture.poses
    cameras = [view.camera for view in views if view.pose_index == 0]
    np.savez(
        tmp_path / "rig.npz",
        K=[camera.K for camera in cameras],
        cam2world=[camera.cam2world for camera in cameras],
        **{name: [getattr(pose, name) for pose in poses] for name in ("theta", "beta", "transl")},
    )
    shutil.copytree(painted_capture.folder, tmp_path / "my_capture/images")
    monkeypatch.chdir(tmp_path)
    (script,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert len(script.splitlines()) <= 22
    exec(compile(script, str(PAGE), "exec"), {})
    capture = load_capture(tmp_path / "my_capture")
    assert [view.split for view in capture.views] == ["train"] * 3 + ["novel_camera"] + ["novel_pose"] * 3 + ["test"]
    for one, other in zip(capture.views, views, strict=True):
        assert (one.camera_index, one.pose_index) == (other.camera_index, other.pose_index)
        np.testing.assert_array_equal(one.camera.cam2world, other.camera.cam2world)
        np.testing.assert_array_equal(capture.read_pixels(one), painted_capture.read_pixels(other))
