"""The paper's figures (LiveHand, ICCV 2023, tables 1 to 4), to stand beside ours.

They are of other data: InterHand2.6M's four users at 334 x 512, PSNR of images that were not clamped, LPIPS (AlexNet)
fed [0, 1], FID of truth that was not blackened beside the hand, frames a second of an RTX 3090. Only the order of a
table's rows can be compared with ours, and FID not even between papers.
"""

from __future__ import annotations

from typing import NamedTuple


class PublishedFigures(NamedTuple):
    """One row; None where the paper has no figure.

    Attributes:
        psnr_db: high is good.
        lpips_1000: LPIPS times 1000, low is good.
        fid: low is good.
        fps: frames a second on an RTX 3090.
        parameters_m: millions.
    """

    psnr_db: float | None
    lpips_1000: float | None
    fid: float | None
    fps: float | None = None
    parameters_m: float | None = None


PUBLISHED: dict[str, PublishedFigures] = {
    "mesh_wrapping": PublishedFigures(28.28, 49.44, 298.28, 82.33),
    "smplpix": PublishedFigures(32.37, 26.57, 202.99, 58.82),
    "a_nerf": PublishedFigures(28.07, 94.41, 318.61, 0.83),
    "lisa": PublishedFigures(29.36, 78.46, 255.43, 3.70),
    "xyz": PublishedFigures(29.31, 42.50, 247.77, 43.03, 0.95),
    "bones": PublishedFigures(32.51, 23.82, 198.95, 27.04, 1.14),
    "no_pose": PublishedFigures(30.33, 32.36, 204.24, 45.73, 0.40),
    "hierarchical": PublishedFigures(31.25, 25.95, 202.40, 9.07),
    "no_sr": PublishedFigures(32.69, 38.45, 226.78, 19.64),
    "no_sr_patch": PublishedFigures(30.52, 31.13, 197.70, 19.52),
    "no_sr_full": PublishedFigures(31.61, 26.63, 197.35, 19.37),
    "paper": PublishedFigures(32.04, 25.73, 197.39, 45.45, 0.41),
}
"""By the names of our rows."""

CONCEPTUAL: tuple[tuple[str, bool, bool, bool, bool], ...] = (
    ("HTML", True, False, False, False),
    ("NIMBLE", True, True, False, False),
    ("LISA", False, False, True, False),
    ("LiveHand", True, True, True, True),
)
"""Table 1: name, real-time, photoreal, pose-dependent, view-dependent look. HTML and NIMBLE are texture models under
research licences without figures in the paper; what they stand for here is the row `mesh_texture`."""

TITLES: dict[str, str] = {
    "comparison": "Comparison with other methods (the paper's table 2)",
    "canonical": "Canonical coordinates and pose (table 3)",
    "components": "Mesh-guided sampling, super-resolution and perceptual loss (table 4)",
    "misfit": "A mesh that does not fit (the paper's supplement has its own levels)",
}
