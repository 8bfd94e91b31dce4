"""Multi-view captures rendered with Cycles: the training data of avatars."""
