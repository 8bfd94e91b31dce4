"""How alike two pictures look: distances between the features of networks trained on photographs by others."""
