"""All that touches Mitsuba: variants, loading, baked light, the renderer."""
