"""The albedo of each texel: what pictures show of it, what they agree on, and what none shows."""
