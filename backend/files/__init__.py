"""Files of other people, opened within bounds on what they may claim: sizes, depth, counts."""
