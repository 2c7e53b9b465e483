"""Interpolation that several methods share."""
