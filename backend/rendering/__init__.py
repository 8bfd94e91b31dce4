"""From a shot to a frame: the renderer, and what composes, decodes and schedules its frames."""
