"""Rendered frames on disk, with times, poses and ground truth."""
