"""All code that uses Mitsuba: variants, loading, baked light, the renderer."""
