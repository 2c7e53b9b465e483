"""Frames through sensors: reading, many sensors at once, memory, sorting."""
