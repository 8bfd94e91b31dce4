"""What light does to a hand: lamps, sky, shadow maps, visibility, BRDF, indirect light and nearby geometry."""
