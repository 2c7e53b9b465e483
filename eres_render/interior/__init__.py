"""The room scene's geometry: furniture as meshes, each with its own texture atlas."""
