"""The do-nothing baseline of optical flow: the flow from which every search starts."""

from __future__ import annotations

from tasks.flow import FlowEstimate, FlowSample


def estimate(sample: FlowSample) -> FlowEstimate:
    """Return the initial flow, whatever the events are."""
    return FlowEstimate(sample.initial)
