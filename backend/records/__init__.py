"""The frozen records of numpy arrays that cross every border, and the one error that users see."""
