"""Random scenes of glowing textured things, each from its seed alone."""
