"""The MANO-format hand: its file, its skinning, its atlas, and the hand we ship."""
