"""The room scene's geometry: furniture as meshes with a texture atlas of their own."""
