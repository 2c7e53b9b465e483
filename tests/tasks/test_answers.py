"""What the scorers accept from a method."""

import numpy as np
import pytest

from tasks.evaluation.answers import flow_answer
from tasks.flow import FlowEstimate


@pytest.mark.parametrize("precision", [np.float16, np.float32, np.float64, np.int32])
def test_flow_may_have_any_precision(precision):
    """Promise: a method answers in its own precision, and its errors are computed in double."""
    answer = np.arange(24).reshape(2, 3, 4).astype(precision)
    found = flow_answer("dense_flow", "own", answer, np.zeros((2, 3, 4)))
    assert found.failure == ""
    assert found.flow.dtype == np.float64
    assert np.array_equal(found.flow, answer)


def test_infinite_flow_in_single_precision_is_a_failure():
    """Promise: a failed method scores like doing nothing, with the reason."""
    answer, nothing = np.full((2, 3, 4), np.inf, np.float32), np.zeros((2, 3, 4))
    found = flow_answer("dense_flow", "own", answer, nothing)
    assert (found.failure, found.flow is nothing) == ("the flow is not finite", True)
    assert isinstance(found, FlowEstimate)
