"""A picture is made smaller for the fit, and what it wants is enlarged back."""

import numpy as np
from livehand.backend.person.fit.pose_targets import OutlineTargets, PoseTargets
from livehand.backend.person.fit.refit import made_smaller
from livehand.backend.records.camera import Camera
from livehand.backend.records.hand_picture import HAND, HandPicture
from livehand.backend.records.shot import HandPose


def test_a_smaller_picture_shows_the_same_and_its_targets_are_enlarged_back():
    size_px, camera = (90, 120), Camera(np.array([[200.0, 0, 45], [0, 200, 60], [0, 0, 1]]), np.eye(4), (90, 120))
    rgb = np.repeat(np.linspace(0, 255, size_px[0]).astype(np.uint8)[None, :, None], 120, 0).repeat(3, 2)
    picture = HandPicture("one", rgb, np.full((120, 90), HAND, np.uint8), camera, HandPose.rest())
    assert made_smaller(picture, 120) is picture
    small = made_smaller(picture, 40)
    assert small.camera.size_px == (30, 40)
    point = np.array([[0.02, -0.03, 0.4]])
    larger_by = np.divide(size_px, small.camera.size_px)
    np.testing.assert_allclose(small.camera.project(point)[0] * larger_by, camera.project(point)[0])
    np.testing.assert_allclose(small.rgb[5, :, 0], rgb[5, 1::3, 0], atol=1)
    outline = OutlineTargets(np.array([3]), np.array([[1.0, 2.0]]), np.array([[0.0, 1.0]]))
    targets = PoseTargets(np.array([[4.0, 5.0]]), np.ones(1), np.eye(2)[None], outline, 1.5, 0.9).enlarged(larger_by)
    np.testing.assert_allclose(targets.px, [[12, 15]])
    np.testing.assert_allclose(targets.outline.px, [[3, 6]])
    np.testing.assert_allclose(targets.outline.normal, [[0, 1]])
    assert (targets.flow_px, targets.overlap) == (4.5, 0.9)
