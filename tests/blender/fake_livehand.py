"""The `livehand` program with a renderer that needs no avatar: `python fake_livehand.py render SHOT.blend -o DIR`.

FAKE_SECONDS in the environment makes every frame take that long.
"""

import os
import time
from types import SimpleNamespace

import numpy as np
from livehand.backend.records.frame import DEPTH_BACKGROUND, Frame


class FakeRenderer:
    """Colours every ray by its direction, and covers the disc around the hand's middle; no avatar, no torch."""

    avatar = SimpleNamespace(name="fake", provenance={"licence": "CC0", "consent": "to all"})
    is_relightable = False
    mean_albedo = None
    frames_at_once = 1
    renders_at_once = False

    def __init__(self, avatar_path=None, hand=None, device=None):
        self.avatar_path, self.hand, self.device = avatar_path, hand, device
        self.shots = []

    def posed_surface(self, shot):
        return None

    def render(self, shot, should_stop=lambda: False):
        time.sleep(float(os.environ.get("FAKE_SECONDS", "0")))
        self.shots.append(shot)
        width, height = shot.camera.size_px
        columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        directions = shot.camera.ray_directions(np.stack([columns, rows], -1))
        middle = shot.vertices.mean(0)
        radius = np.linalg.norm(shot.vertices - middle, axis=1).max()
        pixel, depth = shot.camera.project(middle)
        away_px = np.hypot(columns - pixel[0], rows - pixel[1])
        radius_px = shot.camera.K[0, 0] * radius / (1 if shot.camera.is_orthographic else depth)
        alpha = np.clip(1.5 - away_px / radius_px, 0, 1)
        rgb = (0.5 + 0.5 * directions / np.linalg.norm(directions, axis=-1, keepdims=True)) * alpha[..., None]
        depth_map = np.where(alpha > 0, depth, DEPTH_BACKGROUND)
        return Frame(rgb.astype(np.float32), alpha.astype(np.float32), depth_map.astype(np.float32))


def main():
    import livehand
    from livehand.backend.render.session import Session
    from livehand.livehand_blender.__main__ import program
    from livehand.livehand_blender.render.engine import LiveHandRender

    livehand.register()
    LiveHandRender.hands_session = Session(FakeRenderer)
    program()


if __name__ == "__main__":
    main()
