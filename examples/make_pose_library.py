"""Make the pose library: `poses.blend`, one pose asset per row of `backend/hand/poses.py`, and its catalog file.

Run it with the Python that LiveHand is installed in: `python examples/make_pose_library.py [FOLDER]`. Without a folder,
it replaces the library that ships with LiveHand. The previews are rendered with the light avatar. The script needs
Blender 4.4 or later; Blender 4.2 can read the library.
"""

import sys
import uuid
from pathlib import Path

import bpy
import livehand
import numpy as np
from example_file import write_small
from livehand.backend.avatars.file import load_avatar
from livehand.backend.geometry.framing import fitting_camera
from livehand.backend.geometry.rotation import matrix_to_axis_angle
from livehand.backend.hand.bones import bone_name
from livehand.backend.hand.gestures import FingerAxes, theta_of
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE, UPRIGHT
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.hand.poses import POSES, LibraryPose
from livehand.backend.image.decode import straight_srgb
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.render.renderer import Renderer
from livehand.backend.render.studio_light import studio_light
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.pose import bone_quaternions

ASSETS = Path(livehand.__file__).parent / "livehand_blender" / "assets"
PICTURE_PX = 128
GROUND = 0.22  # sRGB grey behind the hand
FILLED = 0.9  # fraction of the preview that the hand's longer side covers
# Shades of a preview's channel: all 256 would add 100 kB.
SHADES = 85
# How an upright right hand, its back to the front (-Y, where the light is) and its thumb to the left, is turned about
# Z, and where its camera is.
VIEWS = {
    "palm": (np.diag([-1.0, -1, 1]), (0.35, -1.0, 0.15)),
    "thumb": (np.eye(3), (-1.0, -0.1, 0.2)),
}
CATALOG_HEADER = "# This is an Asset Catalog Definition file for Blender.\nVERSION 1\n"


def make_library(folder: Path) -> None:
    """Write the library's two files."""
    armatures = [add_hand(bpy.context, load_default_hand().for_side(side)) for side in ("right", "left")]
    hands = [RiggedHand.of(armature) for armature in armatures]
    renderer = Renderer(load_avatar(), load_default_hand(), "cpu")
    actions = set()
    for name, pose in POSES.items():
        action = pose_action(name, hands, pose)
        describe(action, pose)
        set_preview(action, picture_of(renderer, pose))
        actions.add(action)
    write_small(lambda raw: bpy.data.libraries.write(str(raw), actions, fake_user=True), folder / "poses.blend")
    (folder / "blender_assets.cats.txt").write_text(catalogs())


def theta_of_pose(pose: LibraryPose) -> np.ndarray:
    """[16, 3] of a right hand, the wrist at rest."""
    return theta_of(pose.gesture.angles_deg(), FingerAxes.of_default_hand())


def pose_action(name: str, hands: list[RiggedHand], pose: LibraryPose) -> bpy.types.Action:
    """An action of one frame with the finger bones of both hands, so that either can be posed without flipping."""
    action = bpy.data.actions.new(name)
    slot = action.slots.new("OBJECT", "Hand")
    strip = action.layers.new("Pose").strips.new(type="KEYFRAME")
    curves = strip.channelbag(slot, ensure=True).fcurves
    for hand, theta in zip(hands, (theta_of_pose(pose), theta_of_pose(pose) * MIRROR_AXIS_ANGLE), strict=True):
        quaternions = bone_quaternions(hand, theta)
        for joint in range(1, 16):
            bone = bone_name(joint, hand.side)
            for index, value in enumerate(quaternions[joint]):
                path = f'pose.bones["{bone}"].rotation_quaternion'
                curves.new(path, index=index).keyframe_points.insert(1, value)
    return action


def describe(action: bpy.types.Action, pose: LibraryPose) -> None:
    """Mark the action as an asset with searchable tags."""
    action.asset_mark()
    asset = action.asset_data
    asset.catalog_id = catalog_id(pose.catalog)
    asset.description = pose.description
    asset.author = "The LiveHand for Blender team"
    asset.license = "GPL-3.0-or-later"
    for tag in ("hand", pose.catalog.lower(), *pose.tags):
        asset.tags.new(tag, skip_if_exists=True)


def set_preview(action: bpy.types.Action, picture: np.ndarray) -> None:
    """Set an asset's preview [H, W, 3], sRGB in 0..1, top row first."""
    preview = action.preview_ensure()
    preview.image_size = (PICTURE_PX, PICTURE_PX)
    opaque = np.concatenate([picture, np.ones((PICTURE_PX, PICTURE_PX, 1))], -1)
    preview.image_pixels_float.foreach_set(opaque[::-1].astype(np.float32).ravel())


def picture_of(renderer: Renderer, pose: LibraryPose) -> np.ndarray:
    """[H, W, 3] sRGB in 0..1, the upright right hand on a grey background."""
    theta = theta_of_pose(pose)
    turn, towards_camera = VIEWS[pose.view_from]
    theta[0] = matrix_to_axis_angle(turn @ UPRIGHT)
    hand_pose = HandPose(theta, np.zeros(10), np.zeros(3))
    vertices = posed_vertices(renderer.hand, hand_pose)
    shown = vertices[renderer.hand.framed_vertices]  # poses differ in the hand; the arm may leave the picture
    camera = fitting_camera(shown, towards_camera, (PICTURE_PX, PICTURE_PX), FILLED)
    picture = straight_srgb(renderer.render(Shot(hand_pose, vertices, camera, studio_light())))
    return np.round(SHADES * (picture[..., :3] * picture[..., 3:] + GROUND * (1 - picture[..., 3:]))) / SHADES


def catalog_id(catalog: str) -> str:
    """The same in every run, so that users' assets keep their catalogs."""
    return str(uuid.uuid5(uuid.NAMESPACE_URL, f"livehand/poses/{catalog}"))


def catalogs() -> str:
    """The text of the catalog file."""
    names = dict.fromkeys(pose.catalog for pose in POSES.values())
    return CATALOG_HEADER + "".join(f"{catalog_id(name)}:LiveHand/{name}:LiveHand-{name}\n" for name in names)


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ASSETS
    livehand.register()
    try:
        bpy.ops.wm.read_homefile(use_empty=True)
        make_library(folder)
    finally:
        livehand.unregister()
    print(f"{len(POSES)} poses: {(folder / 'poses.blend').stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
