"""The avatar's surface: detail mesh, detail maps, edges, hole filling and hair."""
