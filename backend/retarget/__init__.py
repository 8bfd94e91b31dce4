"""Hands rigged by other people: their bones as MANO's 16 joints, their motion as theta, their mesh as a hand model."""
