"""The render engine, the loaded avatars it uses, and sequences of frames on disk."""
