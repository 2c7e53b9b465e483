"""Seeded procedural textures: what a surface reflects, at every scale down to a texel.

Detail at all scales is not decoration. How much a low-resolution sensor misses is decided by the
share of contrast that lives below its pixel pitch, so a texture that ends at a centimeter would
hide the very effect that is under study.
"""
