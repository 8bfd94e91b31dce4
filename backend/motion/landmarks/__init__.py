"""Hand landmarks (MediaPipe's 21, WebXR's 25) from files, and the pose of a hand model that fits them."""
