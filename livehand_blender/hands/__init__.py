"""The hands that a frame of the scene shows, as the backend's `Shot`s."""
