"""Seeded procedural textures: what a surface reflects, at every scale down to a texel.

The share of contrast below a sensor's pixel pitch decides how much a low-resolution sensor misses.
A texture without detail finer than a centimeter would hide the effect that we study.
"""
