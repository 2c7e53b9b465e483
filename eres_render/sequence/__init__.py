"""Rendered frames with their times, poses and ground truth, on disk."""
