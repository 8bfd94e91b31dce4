"""The records that cross every border: input and output of the renderer.

They are frozen dataclasses of numpy arrays: no bpy object and no torch tensor crosses a border.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np

from .camera import Camera
from .errors import LiveHandError
from .light import Light
from .side import Side

Quality = Literal["preview", "final"]


@dataclass(frozen=True)
class HandPose:
    """A hand's parameters.

    Attributes:
        theta: [16, 3] axis-angle per joint, rad, in MANO's order (wrist, index, middle, pinky, ring, thumb); always the
            full absolute pose, any mean already added. Joint 0 is the root rotation, about joint 0.
        beta: [10] shape coefficients.
        transl: [3] m.
        side: which hand.
        forearm: [3] axis-angle, rad, of the forearm against the hand, about joint 0; zeros: it goes on straight from
            the hand, turned with it by the root rotation. Models without an arm do not use it.
    """

    theta: np.ndarray
    beta: np.ndarray
    transl: np.ndarray
    side: Side = "right"
    forearm: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self):
        for name, shape in (("theta", (16, 3)), ("beta", (10,)), ("transl", (3,)), ("forearm", (3,))):
            value = getattr(self, name)
            if np.shape(value) != shape:
                raise LiveHandError(f"{name} must be {list(shape)}, got {list(np.shape(value))}")
            if not np.isfinite(value).all():
                raise LiveHandError(
                    f"{name} must be finite, got NaN or infinity; clear the keyframe or driver at fault"
                )
        if self.side not in ("right", "left"):
            raise LiveHandError(f"side must be 'right' or 'left', got {self.side!r}")

    @classmethod
    def rest(cls, side: Side = "right") -> HandPose:
        """Return the template's pose and shape, at the origin."""
        return cls(np.zeros((16, 3)), np.zeros(10), np.zeros(3), side)

    def mirrored(self) -> HandPose:
        """Mirror the pose for the other hand, at the plane x = 0 of the hand's own space."""
        side: Side = "left" if self.side == "right" else "right"
        return replace(
            self,
            theta=self.theta * (1, -1, -1),
            transl=self.transl * (-1, 1, 1),
            side=side,
            forearm=self.forearm * (1, -1, -1),
        )


@dataclass(frozen=True)
class Shot:
    """One hand in one frame.

    Attributes:
        pose: the hand's parameters; the renderer conditions the appearance on them.
        vertices: [V, 3] posed surface in the world, m, in the hand model's vertex order. They come from the evaluated
            mesh, so shape keys, sculpting, modifiers and retargeted rigs are respected.
        camera: the view.
        light: what falls on the hand; None: the light of the avatar's capture. Avatars that are not relightable keep
            their capture's light whatever this is.
        wrist_fade_m: length along the hand at rest over which the frame turns transparent towards the cut end of arm or
            wrist; 0: it ends opaque.
        hair: the share of its hairs that the hand shows, 0 to 1, where its avatar's skin is known.
        quality: "preview" of one of many frames that nobody looks at for long: its surface, its shadows and its
            networks' arithmetic may be coarser, and it has no hairs.
        pressed_m: [V] how far what the hand touches has flattened its skin, which pales there, of avatars with a
            surface; None: it touches nothing.
    """

    pose: HandPose
    vertices: np.ndarray
    camera: Camera
    light: Light | None = None
    wrist_fade_m: float = 0.0
    hair: float = 0.0
    quality: Quality = "final"
    pressed_m: np.ndarray | None = None

    def __post_init__(self):
        if np.ndim(self.vertices) != 2 or np.shape(self.vertices)[1] != 3:
            raise LiveHandError(f"vertices must be [V, 3] m, got {list(np.shape(self.vertices))}")
        if not np.isfinite(self.vertices).all():
            raise LiveHandError("the posed hand must be finite, got NaN or infinity in its vertices")
        if not (np.isfinite(self.wrist_fade_m) and self.wrist_fade_m >= 0):
            raise LiveHandError(f"the wrist's fade must be a length of 0 or more, got {self.wrist_fade_m} m")
        if not 0 <= self.hair <= 1:
            raise LiveHandError(f"the hand's hair must be a share from 0 to 1, got {self.hair}")
        if self.quality not in ("preview", "final"):
            raise LiveHandError(f"a shot's quality must be 'preview' or 'final', got {self.quality!r}")
        if self.pressed_m is not None:
            self._check_pressed(self.pressed_m)

    def _check_pressed(self, pressed_m: np.ndarray) -> None:
        if np.shape(pressed_m) != (len(self.vertices),):
            raise LiveHandError(f"pressed_m must be [{len(self.vertices)}] m, got {list(np.shape(pressed_m))}")
        if not (np.isfinite(pressed_m).all() and np.min(pressed_m) >= 0):
            raise LiveHandError("pressed_m must be finite and 0 or more; grasp again, which flattens the pads anew")

    def with_camera(self, camera: Camera) -> Shot:
        """Show the same hand from another view."""
        return replace(self, camera=camera)


class SurfaceMesh(NamedTuple):
    """The skin's own surface in a pose, finer than the hand's mesh.

    Attributes:
        vertices: [N, 3] m, world.
        faces: [M, 3] into these, counter-clockwise seen from outside.
    """

    vertices: np.ndarray
    faces: np.ndarray
