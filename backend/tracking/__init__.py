"""Hands in pictures: a tracker whose networks' weights the user fetches, and the frames of videos that it looks at."""
