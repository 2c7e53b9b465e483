"""Recordings of real cameras: their events, frames and calibration, and how methods do on them."""
