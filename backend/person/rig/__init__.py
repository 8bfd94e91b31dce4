"""Several calibrated cameras around one or two hands at one instant: poses, cameras and masks of both hands."""
