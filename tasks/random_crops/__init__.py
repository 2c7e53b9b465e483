"""Random textures in motion with their events and truth, to train networks; each from its seed."""
