"""The do-nothing baseline of optical flow: the flow that every search starts from."""

from __future__ import annotations

from tasks.flow import FlowEstimate, FlowSample


def estimate(sample: FlowSample) -> FlowEstimate:
    """The initial flow, whatever the events say."""
    return FlowEstimate(sample.initial)
