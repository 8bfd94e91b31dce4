"""`livehand benchmark`: where a frame's time goes, beside the machine's floor, the paper's renderer and Cycles."""
