"""Scenes: settings, Mitsuba XML, and recipes for textures."""
