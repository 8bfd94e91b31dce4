"""Other rigs: maps their bones to MANO's 16 joints, their motion to theta, and their mesh to a hand model."""
