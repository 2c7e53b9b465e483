"""The do-nothing baseline of pose tracking: the path that every search starts from."""

from __future__ import annotations

from tasks.tracking import TrackingEstimate, TrackingSample


def estimate(sample: TrackingSample) -> TrackingEstimate:
    """The initial path, whatever the events say."""
    return TrackingEstimate(sample.initial)
