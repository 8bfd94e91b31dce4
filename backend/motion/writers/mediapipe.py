"""MediaPipe's 21 world landmarks as JSON, named as its holistic tracker names them; axes of a camera, metres.

Points tell bones alone: a motion that is read back is fitted to them, so that a straight finger's twist is lost.
"""

from __future__ import annotations

import json
from pathlib import Path

from ...system.files import replacing
from .posed_joints import pose_joints
from .take import Take
from .writer import WriteOptions, Writer

_DECIMALS_M = 7
_LOSS = "landmarks are points: how a straight finger twists is not in the file"


def _write(take: Take, path: Path, options: WriteOptions) -> tuple[str, ...]:
    points = {
        hand.side: pose_joints(hand.motion_in("opencv"), hand.own_model, hand.scale).landmarks.round(_DECIMALS_M)
        for hand in take.hands
    }
    frames = [
        {
            f"{hand.side}_hand_world_landmarks": [
                dict(zip("xyz", point, strict=True)) for point in points[hand.side][number - hand.first].tolist()
            ]
            for hand in take.hands
            if number in hand.frames
        }
        | {"timestamp_ms": float(time_s) * 1e3}
        for number, time_s in enumerate(take.times_s)
    ]
    with replacing(path) as temporary:
        temporary.write_text(json.dumps({"fps": take.fps, "frames": frames}, separators=(",", ":")), encoding="utf-8")
    return (_LOSS,)


MEDIAPIPE = Writer("mediapipe", "MediaPipe landmarks", (".json",), _write)
