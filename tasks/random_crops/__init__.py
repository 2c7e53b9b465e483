"""Random textures in motion with events and ground truth, each from a seed, to train networks."""
