"""Errors of the render package. Messages name the file and field, and the wrong value."""

import difflib
import math
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from errno import EINVAL
from pathlib import Path

_MAX_CHARACTERS = 500  # of a library's message, which may quote the file


class RenderError(ValueError):
    """A request to the renderer cannot be carried out; the base class of all errors here.

    Examples
    --------
    >>> from eres_render import Camera
    >>> Camera(1280, 720)
    Traceback (most recent call last):
    eres_render.errors.RenderError: Camera: needs fov_rad or fx, and has neither
    """


class SceneError(RenderError):
    """A scene is unknown or incomplete, or one of its values is out of range.

    Examples
    --------
    >>> from eres_render import load_scene
    >>> load_scene("carpets")
    Traceback (most recent call last):
    eres_render.errors.SceneError: ... 'carpets': did you mean 'carpet'?
    """


class TrajectoryError(RenderError):
    """A camera path is malformed, leaves its scene, or does not cover a requested time.

    Examples
    --------
    >>> from eres_render import load_scene
    >>> load_scene("carpet").trajectory().pose(60.0)
    Traceback (most recent call last):
    eres_render.errors.TrajectoryError: the path covers 0 to 10 s; ...
    """


class SequenceError(RenderError):
    """A radiance sequence on disk is missing, damaged, unfinished or of a different version.

    Examples
    --------
    >>> from eres_render import open_sequence
    >>> open_sequence("frames/clip_000")
    Traceback (most recent call last):
    eres_render.errors.SequenceError: frames/clip_000/manifest.json: ...
    """


class BackendError(RenderError):
    """No Mitsuba variant on this machine can carry out a request.

    Examples
    --------
    >>> import os
    >>> from eres_render import Renderer, load_scene
    >>> os.environ["ERES_VARIANT"] = "fastest"
    >>> Renderer(load_scene("carpet"))
    Traceback (most recent call last):
    eres_render.errors.BackendError: ERES_VARIANT: found 'fastest', expected one of ...
    >>> del os.environ["ERES_VARIANT"]
    """


@contextmanager
def reading(file: Path, format: str, error: type[ValueError]) -> Iterator[None]:
    """Turn any exception while a file is read into an error that starts with the file's name."""
    try:
        yield
    except (RenderError, error) as reason:
        named = str(reason).startswith(str(file))
        if named and isinstance(reason, error):
            raise
        raise error(str(reason) if named else f"{file}: {reason}") from reason
    except Exception as reason:
        text = f"could not be read as {format}: {_in_one_line(reason)}"
        if isinstance(reason, FileNotFoundError):
            text = "no such file"
        # A damaged offset is EINVAL; libraries that describe the content give no number.
        elif isinstance(reason, OSError) and reason.errno not in (None, EINVAL):
            text = f"cannot be read: {reason.strerror}"
        raise error(f"{file}: {text}") from reason


def _in_one_line(error: Exception) -> str:
    """Return the text of an error, or its name if it has none."""
    if isinstance(error, RecursionError):
        return "nested too deeply"
    return " ".join(str(error).split())[:_MAX_CHARACTERS] or type(error).__name__


def suggestion(name: str, known: Collection[str]) -> str:
    """Return a hint for an unknown name."""
    near = difflib.get_close_matches(name, known, n=2, cutoff=0.5)
    if not near:
        return f"choose from: {', '.join(known)}"
    alike = [difflib.SequenceMatcher(None, other, name).ratio() for other in near]
    as_near = near if alike[-1] > alike[0] - 0.05 else near[:1]
    return f"did you mean {' or '.join(map(repr, as_near))}?"


def check_positive(
    name: str, value: float, error: type[ValueError], expected: str = "a positive number"
) -> None:
    """Refuse a number that is not positive and finite; `expected` describes the valid values."""
    if not 0 < value < math.inf:
        raise error(f"{name}: found {value}, expected {expected}")


def check_spp(spp: int, error: type[ValueError]) -> None:
    """Refuse a number of samples per pixel that the multijittered sampler cannot lay out."""
    rows = math.isqrt(max(spp, 0))
    if rows == 0 or spp % rows:
        raise error(f"spp: found {spp}, expected a square or almost, such as 4, 6 or 9")
