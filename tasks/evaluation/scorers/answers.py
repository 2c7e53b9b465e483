"""What methods answer, checked before it is scored.

An answer that is not finite is a failure, and counts as one. What is no answer at all, and whatever
a method raises, is a mistake in the method: it ends the run with a `MethodError` that says whose it
is and where.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eres_render import Trajectory
from tasks.errors import MethodError
from tasks.flow import FlowEstimate, FlowSample
from tasks.methods import source_file
from tasks.tracking import TrackingEstimate, TrackingSample

_INFINITE = 1e150  # px, m: the square of more has no room in a float
_SAME_S = 1e-9  # as near as a path's end must be to that of the initial one


def ask(
    task: str, name: str, function: Callable[..., Any], *arguments: Any, **options: Any
) -> tuple[Any, float]:
    """Run a function of a method.

    Parameters
    ----------
    task, name
        Whose method it is, and its name.
    function, arguments, options
        What to run.

    Returns
    -------
    The answer, and the seconds of this thread's CPU time that it took.

    Raises
    ------
    MethodError
        From whatever error the method raised; the text names the method and the line.
    """
    started_s = time.thread_time()
    try:
        answer = function(*arguments, **options)
    except Exception as error:
        text = " ".join(str(error).split())
        raise MethodError(
            f"{task}, method {name!r}: raised {type(error).__name__}"
            f"{_place(error, task, name)}{': ' if text else ''}{text}"
        ) from error
    return answer, time.thread_time() - started_s


def _place(error: Exception, task: str, name: str) -> str:
    """Where the method's own file had got to, or else where the error was raised."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if frame.filename == source_file(task, name)]
    frame = (own or frames)[-1]
    return f" at {frame.filename}:{frame.lineno}"


def flow_answer(name: str, sample: FlowSample, answer: Any) -> FlowEstimate:
    """A flow method's answer; failed, and the initial flow, where it is not finite.

    Raises
    ------
    MethodError
        It is no `FlowEstimate` of one flow.
    """
    if not isinstance(answer, FlowEstimate):
        raise _refusal("flow", name, _named(answer), "a tasks.flow.FlowEstimate")
    _check_failure("flow", name, answer.failure)
    flow = _numbers(answer.flow, (2,))
    if flow is None:
        found = f"a FlowEstimate whose flow is {_named(answer.flow)}"
        raise _refusal("flow", name, found, "two numbers")
    if not np.all(np.abs(flow) < _INFINITE):
        return FlowEstimate(sample.initial, answer.failure or "the flow is not finite")
    return answer


def path_answer(name: str, sample: TrackingSample, answer: Any) -> TrackingEstimate:
    """A tracking method's answer; failed, and the initial path, where it is not finite.

    Raises
    ------
    MethodError
        It is no `TrackingEstimate` of a path as long as the initial one.
    """
    if not isinstance(answer, TrackingEstimate):
        raise _refusal("tracking", name, _named(answer), "a tasks.tracking.TrackingEstimate")
    _check_failure("tracking", name, answer.failure)
    path, least_s = answer.path, sample.initial.duration_s
    if not isinstance(path, Trajectory):
        found = f"a TrackingEstimate whose path is {_named(path)}"
        raise _refusal("tracking", name, found, "an eres_render.Trajectory")
    if not np.all(np.abs(path.controls) < _INFINITE):
        failure = answer.failure or "the path is not finite"
        return TrackingEstimate(sample.initial, failure, answer.diagnostics)
    if path.duration_s < least_s - _SAME_S:
        found = f"a path of {path.duration_s:g} s"
        raise _refusal("tracking", name, found, f"one of at least {least_s:g} s")
    return answer


def image_answer(
    task: str, name: str, answer: Any, nothing: NDArray[np.float64]
) -> tuple[NDArray[np.floating], str]:
    """An image and why the method failed, or ""; `nothing` in its place where it is not finite.

    Parameters
    ----------
    nothing
        (H, W), the image of a method that does nothing, of the size that is expected.

    Raises
    ------
    MethodError
        It is no image of that size.
    """
    image = _numbers(answer, nothing.shape)
    if image is None:
        height, width = nothing.shape
        raise _refusal(task, name, _named(answer), f"an array of numbers of ({height}, {width})")
    if not np.all(np.isfinite(image)):
        return nothing, "the image is not finite"
    return image, ""


def _check_failure(task: str, name: str, failure: Any) -> None:
    if not isinstance(failure, str):
        raise _refusal(task, name, f"{_named(failure)} as failure", 'the reason, or "" for none')


def _refusal(task: str, name: str, found: str, expected: str) -> MethodError:
    return MethodError(f"{task}, method {name!r}: returned {found}, expected {expected}")


def _numbers(found: Any, shape: tuple[int, ...]) -> NDArray[np.floating] | None:
    """An array of real numbers of a shape, or None where it is none."""
    try:
        array = np.asarray(found)
    except Exception:  # of lists of several lengths, or of a library's own arrays
        return None
    return array if array.shape == shape and array.dtype.kind in "fiu" else None


def _named(found: Any) -> str:
    if found is None:
        return "None"
    kind = type(found).__name__
    if isinstance(found, np.ndarray):
        return f"an array of {found.shape} {found.dtype}"
    return f"{'an' if kind[0] in 'aeiouAEIOU' else 'a'} {kind}"
