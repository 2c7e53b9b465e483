"""Which Mitsuba variant works here; the code is in `eres_render.rendering.backend`."""

from eres_render.rendering.backend import VariantVerdict, probe_variants, select_variant

__all__ = ["VariantVerdict", "probe_variants", "select_variant"]
