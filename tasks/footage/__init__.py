"""Frames of light from footage: videos, and folders of images."""

from tasks.footage.footage import Footage, open_footage

__all__ = ["Footage", "open_footage"]
