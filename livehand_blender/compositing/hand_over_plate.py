"""Compositor nodes for rendered frames of a hand (from `livehand render`) over a plate."""

from __future__ import annotations

from dataclasses import dataclass

import bpy

from ...backend.records.errors import LiveHandError
from .block import Block
from .image_files import ImageFiles
from .tree import compositor_of

# EXR files hold premultiplied linear colour, PNG files straight alpha.
_ALPHA_MODES = {".exr": "PREMUL", ".png": "STRAIGHT"}


@dataclass(frozen=True)
class Plate:
    """The background of the hand.

    Attributes:
        source: a still, an image sequence or a movie on disk, or a movie clip of the .blend.
        delay_frames: number of frames by which images are shifted later; a movie's first frame is number 1. A clip
            has its own settings instead.
    """

    source: ImageFiles | bpy.types.MovieClip
    delay_frames: int = 0


def hand_over_plate(scene: bpy.types.Scene, hand: ImageFiles, plate: Plate, replace_output: bool) -> bool:
    """Build the nodes in the scene's compositor: `hand + (1 - alpha) * plate`.

    A numbered image is shown at the frame of its number. Before a sequence and in its gaps there is no hand; after it,
    its last image remains.

    Args:
        scene: its compositor gets the nodes.
        hand: frames with alpha.
        plate: behind it.
        replace_output: feed the compositor's output even if something else feeds it.

    Returns:
        Whether these nodes feed the compositor's output.

    Raises:
        LiveHandError: Blender cannot read a file, or the hand's file is neither EXR nor PNG.
    """
    if hand.path.suffix.lower() not in _ALPHA_MODES:
        raise LiveHandError(f"the hand's frames must be EXR or PNG files, got {hand.path.name}; choose one of those")
    # Before any node is added, so that a file that cannot be read changes nothing.
    hand_image = hand.load()
    hand_image.alpha_mode = _ALPHA_MODES[hand.path.suffix.lower()]
    plate_image = plate.source.load() if isinstance(plate.source, ImageFiles) else plate.source
    block = Block(compositor_of(scene), "hand_over_plate", "LiveHand: Hand over Plate")
    hand_node = _image_node(block, "hand", (0, 0), hand_image)
    plate_node = _image_node(block, "plate", (0, 1), plate_image)
    _show_at(hand_node, hand)
    if isinstance(plate.source, ImageFiles):
        _show_at(plate_node, plate.source, plate.delay_frames)
    over, inputs = block.add_over("result", (1, 0))
    block.link(_colour(plate_node), inputs["background"])
    block.link(_colour(hand_node), inputs["foreground"])
    block.restore()
    return block.feed_output(over.outputs["Image"], replace_output)


def _image_node(
    block: Block, role: str, at: tuple[int, int], source: bpy.types.Image | bpy.types.MovieClip
) -> bpy.types.Node:
    if isinstance(source, bpy.types.MovieClip):
        node = block.add("CompositorNodeMovieClip", role, at)
        node.clip = source
    else:
        node = block.add("CompositorNodeImage", role, at)
        node.image = source
    return node


def _show_at(node: bpy.types.Node, files: ImageFiles, delay_frames: int = 0) -> None:
    """Set which file an Image node shows at which frame; a still needs no settings."""
    if files.source == "FILE":
        return
    is_movie = files.source == "MOVIE"
    node.frame_duration = node.image.frame_duration if is_movie else files.last_frame - files.first_frame + 1
    node.frame_start = files.first_frame + delay_frames
    node.frame_offset = files.first_frame - 1


def _colour(node: bpy.types.Node) -> bpy.types.NodeSocket:
    """Return the colour output; a multilayer EXR has one output for each pass."""
    return node.outputs["Combined"] if "Combined" in node.outputs else node.outputs["Image"]
