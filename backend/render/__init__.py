"""From a shot to a frame: the renderer, and what composes and schedules its frames."""
