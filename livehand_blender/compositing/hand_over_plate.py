"""Finished frames of a hand, as `livehand render` writes them, over a plate."""

from __future__ import annotations

from dataclasses import dataclass

import bpy

from ...backend.errors import LiveHandError
from .block import Block
from .picture_files import PictureFiles
from .tree import compositor_of

# What a file holds: EXR light, premultiplied; PNG a picture, straight.
_ALPHA_MODES = {".exr": "PREMUL", ".png": "STRAIGHT"}


@dataclass(frozen=True)
class Plate:
    """What lies behind the hand.

    Attributes:
        pictures: a still, an image sequence or a movie; None takes the clip.
        clip: a movie clip of the file.
        delay_frames: frames by which the pictures come later than their numbers say; a movie's first is number 1.
    """

    pictures: PictureFiles | None = None
    clip: bpy.types.MovieClip | None = None
    delay_frames: int = 0


def hand_over_plate(scene: bpy.types.Scene, hand: PictureFiles, plate: Plate, replace_output: bool) -> bool:
    """Build the nodes in the scene's compositor: `hand + (1 - alpha) * plate`.

    A numbered picture is shown at the scene's frame of that number; before and after a sequence the hand is not there.

    Args:
        scene: whose compositor it is.
        hand: frames with alpha.
        plate: behind it.
        replace_output: feed the compositor's output even if something else feeds it.

    Returns:
        Whether these nodes feed the compositor's output.

    Raises:
        LiveHandError: there is no plate, Blender cannot read a file, or the hand's has another kind than EXR and PNG.
    """
    if hand.path.suffix.lower() not in _ALPHA_MODES:
        raise LiveHandError(f"the hand's frames must be EXR or PNG files, got {hand.path.name}; choose one of those")
    if plate.pictures is None and plate.clip is None:
        raise LiveHandError("a plate is needed; choose a picture or a movie, or load a clip into the scene")
    hand_image = hand.load()
    plate_image = plate.pictures and plate.pictures.load()
    block = Block(compositor_of(scene), "hand_over_plate", "LiveHand: Hand over Plate")
    hand_image.alpha_mode = _ALPHA_MODES[hand.path.suffix.lower()]
    hand_node = _picture_node(block, hand_image, hand, "hand", 0)
    if plate_image:
        plate_node = _picture_node(block, plate_image, plate.pictures, "plate", 1, plate.delay_frames)
    else:
        plate_node = block.add("CompositorNodeMovieClip", "plate", (0, 1))
        plate_node.clip = plate.clip
    over, inputs = block.add_over("result", (1, 0))
    block.link(_colour(plate_node), inputs["background"])
    block.link(_colour(hand_node), inputs["foreground"])
    block.restore()
    return block.feed_output(over.outputs["Image"], replace_output)


def _picture_node(
    block: Block, image: bpy.types.Image, files: PictureFiles, role: str, row: int, delay_frames: int = 0
) -> bpy.types.Node:
    node = block.add("CompositorNodeImage", role, (0, row))
    node.image = image
    if files.source != "FILE":
        is_movie = files.source == "MOVIE"
        node.frame_duration = image.frame_duration if is_movie else files.last_frame - files.first_frame + 1
        node.frame_start = files.first_frame + delay_frames
        node.frame_offset = files.first_frame - 1
    return node


def _colour(node: bpy.types.Node) -> bpy.types.NodeSocket:
    """The output with the picture: a multilayer EXR has one for each pass."""
    return node.outputs["Combined"] if "Combined" in node.outputs else node.outputs["Image"]
