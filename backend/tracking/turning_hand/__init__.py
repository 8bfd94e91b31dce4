"""One hand that turns before a resting camera, filmed, as a capture."""
