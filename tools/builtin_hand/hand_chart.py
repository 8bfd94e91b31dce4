"""Makes the chart of the built-in hand (`backend/surface/people/hand_chart.py`) from the teacher's anatomy.

    python -m livehand.tools.builtin_hand.hand_chart FILE

writes the file that ships beside the hand. It says of every vertex of the detail surface where on which digit it lies,
so that skin can be drawn on the hand without the teacher, which does not ship.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from ...backend.hand.model_file import load_default_hand
from ...backend.surface.detail_mesh import DetailTemplate
from ...backend.surface.detail_surface import load_detail_surface
from ...backend.surface.people.hand_chart import COORDINATE_STEP_MM, REACH_MM, SHARE_STEP, WHOLE_SHARE
from ...backend.system.readers import npz_bytes
from ...backend.teacher.anatomy import DIGITS
from ...backend.teacher.details import nail_coordinates
from ...backend.teacher.frames import swap_distal, template_to_build
from ...backend.teacher.rays import Ray, RayCoordinates, build_rays
from ...backend.teacher.skin_masks import skin_masks

_FAR = np.array([-300.0, 0, 0, 0, -8, 0])
"""Coordinates of what lies on no digit."""


def chart_arrays(points_m: np.ndarray, normals: np.ndarray) -> dict[str, np.ndarray]:
    """Encode the chart.

    Args:
        points_m: [N, 3] vertices of the right hand's detail surface at rest, template frame.
        normals: [N, 3] unit.
    """
    rays, build = build_rays(), template_to_build(points_m)
    masks = skin_masks(rays, build, normals)
    points = swap_distal(build)
    at = [rays[digit].coordinates(points) for digit in DIGITS]
    distance = np.stack([one.distance for one in at], 1)
    columns = [_columns(rays[digit], one) for digit, one in zip(DIGITS, at, strict=True)]
    is_near = (distance < REACH_MM)[..., None]
    coordinates = np.where(is_near, np.stack(columns, 1), _FAR)
    return {
        "digit": distance.argmin(1).astype(np.int8),
        "distance": _steps(distance.min(1).clip(0, REACH_MM), COORDINATE_STEP_MM, np.int16),
        "along_lateral": _steps(coordinates[..., :2], COORDINATE_STEP_MM, np.int16),
        "shares": _steps(coordinates[..., 2:].clip(-8, 8), SHARE_STEP, np.int16),
        "palm": _steps(masks["palm"], 1 / WHOLE_SHARE, np.uint8),
        "arm": _steps(masks["arm"], 1 / WHOLE_SHARE, np.uint8),
        "joints_along": np.array([rays[digit].joints_along for digit in DIGITS], np.float32),
        "length": np.array([rays[digit].length for digit in DIGITS], np.float32),
    }


def _columns(ray: Ray, at: RayCoordinates) -> np.ndarray:
    """Return [N, 6]: along and lateral, mm; lateral and dorsal offset over the section's; along and across the nail."""
    section = ray.section(at.along)
    nail = nail_coordinates(ray, at, section)
    lateral, dorsal = at.lateral / section.half_breadth, at.dorsal / section.depth(at.dorsal)
    return np.stack([at.along, at.lateral, lateral, dorsal, nail.along, nail.across], 1)


def _steps(values: np.ndarray, step: float, kind: type[np.integer]) -> np.ndarray:
    limits = np.iinfo(kind)
    return np.round(values / step).clip(limits.min, limits.max).astype(kind)


def main() -> None:
    """Write the file."""
    parser = argparse.ArgumentParser(description="Make the chart of the built-in hand.")
    parser.add_argument("file", type=Path, help="to write")
    model = load_default_hand()
    surface = load_detail_surface(model.sha256)
    assert surface is not None
    template = DetailTemplate.of(surface, model)
    arrays = chart_arrays(template.rest_vertices().numpy(), template.normals.numpy())
    parser.parse_args().file.write_bytes(npz_bytes(arrays))


if __name__ == "__main__":
    main()
