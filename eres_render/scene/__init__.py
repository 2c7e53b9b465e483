"""A scene: its folder, its settings, its Mitsuba XML, and the recipes of its textures."""
