"""The do-nothing baseline of pose tracking: the path from which every search starts."""

from __future__ import annotations

from tasks.tracking import TrackingEstimate, TrackingSample


def estimate(sample: TrackingSample) -> TrackingEstimate:
    """Return the initial path, whatever the events are."""
    return TrackingEstimate(sample.initial)
