"""Makes the file of where hairs grow on the built-in hand (`backend/surface/hair_growth.py`), after anatomy.

Palm, tips and thumb have none; the backs of the proximal phalanges have tufts, those of the middle ones few, the back
of the hand a thin growth towards the little finger, and the forearm the most, on its back.

    python -m livehand.tools.builtin_hand.hair_shares FOLDER
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...backend.hand.model import HandModel
from ...backend.hand.model_file import load_default_hand
from ...backend.surface.base_surface import HAIR_FILE
from ...backend.surface.detail_mesh import DetailTemplate
from ...backend.surface.detail_surface import load_detail_surface
from ...backend.surface.hair_growth import REGIONS
from ...backend.system.readers import npz_bytes

WRIST, PROXIMAL, MIDDLE = 0, (1, 4, 7, 10), (2, 5, 8, 11)
"""Bones that bear hairs, MANO's numbers; the first moves the palm and the forearm."""
# Along the template's x, m, which ends at the elbow: where the forearm's hairs begin, and where they are the most.
_ARM_FROM_M, _ARM_ALL_M = 0.085, 0.125
_DORSAL = (0, 1.0, 0)  # template frame, right hand


class _Skin(NamedTuple):
    """The detail surface of the right hand at rest.

    Attributes:
        vertices, normals: [V, 3] template metres.
        faces: [M, 3].
        bone: [M] that moves a face most.
        joints: [16, 3] MANO's.
    """

    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    bone: np.ndarray
    joints: np.ndarray


def hair_shares(template: DetailTemplate, hand: HandModel) -> np.ndarray:
    """Compute [M, H] float32, as `HairGrowth.share` for `REGIONS`; template and hand are the right one's."""
    tensors = template.rest_vertices(), template.normals, template.faces, template.bones.of_face
    vertices, normals, faces, bone = (values.cpu().numpy() for values in tensors)
    skin = _Skin(vertices, normals, faces, bone, hand.joints)
    found = _shares(skin, skin.vertices[skin.faces].mean(1))
    return np.stack([found[name] for name in REGIONS], 1).astype(np.float32)


def _shares(skin: _Skin, middle: np.ndarray) -> dict[str, np.ndarray]:
    """Compute [M] each: of the most hairs, the share that grows on each face, region by region."""
    normal = skin.normals[skin.faces].mean(1)
    dorsal = normal @ np.array(_DORSAL)
    on_palm = skin.bone == WRIST
    arm = _step(middle[:, 0], _ARM_FROM_M, _ARM_ALL_M)
    back = _step(dorsal, 0.5, 0.9) * _step(-middle[:, 2], -0.015, 0.03) * (1 - arm)
    return {
        "forearm": on_palm * arm * (0.15 + 0.85 * _step(dorsal, -0.3, 0.5)),
        "back": on_palm * back * _step(middle[:, 0], 0.01, 0.03),
        "proximal": _on_phalanges(skin, PROXIMAL, middle, normal),
        "middle": _on_phalanges(skin, MIDDLE, middle, normal),
    }


def _on_phalanges(skin: _Skin, bones: tuple[int, ...], middle: np.ndarray, normal: np.ndarray) -> np.ndarray:
    return np.sum([_on_phalanx(skin, bone, middle, normal) for bone in bones], axis=0)


def _on_phalanx(skin: _Skin, bone: int, middle: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Compute the share of the most hairs that grow on each face: on the back of a phalanx, between its joints."""
    along = skin.joints[bone + 1] - skin.joints[bone]
    length_m = np.linalg.norm(along)
    along = along / length_m
    dorsal = np.array(_DORSAL) - along * along[1]
    place = (middle - skin.joints[bone]) @ along / length_m
    between = _step(place, 0.2, 0.4) * _step(-place, -0.9, -0.7)
    return (skin.bone == bone) * between * _step(normal @ (dorsal / np.linalg.norm(dorsal)), 0.55, 0.9)


def _step(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Step smoothly from 0 at `low` to 1 at `high`."""
    share = np.clip((values - low) / (high - low), 0, 1)
    return share * share * (3 - 2 * share)


def main() -> None:
    """Write the file."""
    parser = argparse.ArgumentParser(description="Make the file of where hairs grow on the built-in hand.")
    parser.add_argument("folder", type=Path, help="where to write it")
    folder, hand = parser.parse_args().folder, load_default_hand()
    surface = load_detail_surface(hand.sha256)
    assert surface is not None
    share = hair_shares(DetailTemplate.of(surface, hand), hand)
    (folder / HAIR_FILE).write_bytes(npz_bytes({"share": share}))


if __name__ == "__main__":
    main()
