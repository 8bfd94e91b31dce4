"""The render engine LIVEHAND, and sequences of frames on disk."""
