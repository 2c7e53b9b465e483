"""Datasets of random scenes: light, events and ground truth, for training networks."""
