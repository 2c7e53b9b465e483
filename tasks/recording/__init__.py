"""Recordings of real cameras: their events, frames and calibration, and scores of methods."""
