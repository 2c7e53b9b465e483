"""Interpolation, splines and estimates with intervals that several methods share."""
