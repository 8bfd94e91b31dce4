"""Each pose and side has its own mesh in a view."""

import numpy as np
import pytest
import torch
from livehand.backend.evaluation.figures import PosedHands
from livehand.backend.geometry.rasterise import rasterise
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.shot import HandPose


@pytest.mark.slow
def test_a_view_sees_its_own_pose_and_side(painted_capture):
    hand = load_default_hand()
    left = HandPose(np.zeros((16, 3)), np.zeros(10), hand.joints[4] * [1, -1, -1], "left")
    poses = (*painted_capture.poses, left)
    vertices = [posed_vertices(hand, pose) for pose in poses]
    hands = PosedHands(hand, [pose.side for pose in poses], vertices)
    view = painted_capture.views[0]
    covered = []
    for index in (0, 1, 2, 0):
        seen = hands.visible_to(type(view)(view.file, view.camera, 0, index, "train"))
        positions_px, depth = view.camera.project(vertices[index])
        faces = hand.for_side(poses[index].side).f
        found = rasterise(*(torch.as_tensor(x) for x in (positions_px, depth, faces)), view.camera.size_px)
        expected = torch.full((24 * 32,), torch.inf, dtype=torch.float64)
        expected = expected.scatter_reduce(0, found.pixel, found.depth, "amin").reshape(32, 24)
        close = (seen.depth - expected).abs() < 1e-4
        assert (close | (seen.depth.isinf() & expected.isinf())).double().mean() > 0.99
        covered.append(seen.depth.isfinite())
    assert covered[0].equal(covered[3])
    assert not covered[0].equal(covered[1])
    assert covered[2].sum() > 20
