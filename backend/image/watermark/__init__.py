"""An invisible watermark of 64 bits in pictures of hands, which outlives compression, crops and resizing."""
