"""Run methods, and check their answers before they are scored.

An answer that is not finite counts as a failure. An answer of another type or shape, or an error in
a method, ends the run with a `MethodError` that names the method and the line.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from copy import deepcopy
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eres_render import Trajectory
from tasks.cpu_time import cpu_s
from tasks.errors import MethodError, WeightsError
from tasks.flow import FlowEstimate
from tasks.methods import source_file
from tasks.registry import TASKS
from tasks.tracking import TrackingEstimate, TrackingSample

_INFINITE = 1e150  # px, m: the square of a larger number overflows
_SAME_S = 1e-9  # tolerance: how much shorter than the initial path a path may be


def ask(
    task: str, name: str, function: Callable[..., Any], *arguments: Any, **options: Any
) -> tuple[Any, float]:
    """Run a function of a method; return its answer and its CPU time in all threads, s.

    A user's method gets copies of arrays and events: it may change them in place, and other methods
    get the same sample.
    """
    if TASKS[task].is_own(name):
        arguments = deepcopy(arguments)
    started_s = cpu_s()
    try:
        answer = function(*arguments, **options)
    except WeightsError:  # its text is clear on its own
        raise
    except Exception as error:
        text = " ".join(str(error).split())
        raise MethodError(
            f"{task}, method {name!r}: raised {type(error).__name__}"
            f"{_place(error, task, name)}{': ' if text else ''}{text}"
        ) from error
    return answer, cpu_s() - started_s


def ask_each(
    task: str, name: str, function: Callable[..., Iterator[Any]], *arguments: Any
) -> Iterator[tuple[Any, float]]:
    """Run a function of a method that yields answers, one after another."""
    answers, _ = ask(task, name, function, *arguments)  # a generator, which has not started
    answer: Any = ()
    while answer is not None:
        answer, cpu_s = ask(task, name, partial(next, answers, None))
        yield answer, cpu_s


def _place(error: Exception, task: str, name: str) -> str:
    """Return the line that raised, in the method's own file if it is there."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if frame.filename == source_file(task, name)]
    frame = (own or frames)[-1]
    return f" at {frame.filename}:{frame.lineno}"


def flow_answer(task: str, name: str, answer: Any, nothing: NDArray[np.float64]) -> FlowEstimate:
    """Check the answer of a flow method, of one patch or of all pixels.

    The answer is a `FlowEstimate` for a patch, (2, h, w) flow for all pixels. `nothing`, the flow
    of a method that does nothing, is (2,) or (2, h, w), and replaces flow that is not finite.
    """
    estimate, start = FlowEstimate(answer), ""
    if nothing.ndim == 1:
        _check_estimate(task, name, answer, FlowEstimate)
        estimate, start = answer, "a FlowEstimate whose flow is "
    flow = _numbers(task, name, estimate.flow, nothing.shape, start)
    flow = flow.astype(np.float64, copy=False)  # squares overflow far earlier in single precision
    if not np.all(np.abs(flow) < _INFINITE):
        return FlowEstimate(nothing, estimate.failure or "the flow is not finite")
    return replace(estimate, flow=flow)


def path_answer(name: str, sample: TrackingSample, answer: Any) -> TrackingEstimate:
    """Check the answer of a tracking method."""
    of_method = "tracking", name
    _check_estimate(*of_method, answer, TrackingEstimate)
    path, least_s = answer.path, sample.initial.duration_s
    text = f"a TrackingEstimate whose path is {_named(path)}"
    _check(isinstance(path, Trajectory), *of_method, text, "an eres_render.Trajectory")
    if not np.all(np.abs(path.controls) < _INFINITE):
        failure = answer.failure or "the path is not finite"
        return TrackingEstimate(sample.initial, failure, answer.diagnostics)
    is_whole = path.duration_s >= least_s - _SAME_S
    text = f"a path of {path.duration_s:g} s"
    _check(is_whole, *of_method, text, f"a path of at least {least_s:g} s")
    return replace(answer, path=deepcopy(path))  # the method may have changed it after using it


def image_answer(
    task: str, name: str, answer: Any, nothing: NDArray[np.float64]
) -> tuple[NDArray[np.floating], str]:
    """Check a method's (H, W) image; return it and "", or `nothing` and why if it is not finite."""
    image = _numbers(task, name, answer, nothing.shape)
    if not np.all(np.isfinite(image)):
        return nothing, "the image is not finite"
    return image, ""


def _check_estimate(task: str, name: str, answer: Any, kind: type) -> None:
    expected = f"a {kind.__module__}.{kind.__name__}"
    _check(isinstance(answer, kind), task, name, _named(answer), expected)
    text = f"{_named(answer.failure)} as failure"
    _check(isinstance(answer.failure, str), task, name, text, 'a str: the reason, or "" for none')


def _check(holds: bool, task: str, name: str, answer: str, expected: str) -> None:
    if not holds:
        raise MethodError(f"{task}, method {name!r}: returned {answer}, expected {expected}")


def _numbers(
    task: str, name: str, value: Any, shape: tuple[int, ...], start: str = ""
) -> NDArray[Any]:
    """Return an array of real numbers of that shape; `start` is of the error."""
    array = np.empty(())
    with suppress(Exception):  # lists of different lengths, or arrays of another library
        array = np.asarray(value)
    is_right = array.shape == shape and array.dtype.kind in "fiu"
    expected = "two numbers" if shape == (2,) else f"an array of numbers of shape {shape}"
    _check(is_right, task, name, f"{start}{_named(value)}", expected)
    return array


def _named(value: Any) -> str:
    if value is None:
        return "None"
    kind = type(value).__name__
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape} and type {value.dtype}"
    return f"{'an' if kind[0] in 'aeiouAEIOU' else 'a'} {kind}"
