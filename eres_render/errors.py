"""Errors of the render package. Each message names file, field, found and expected value."""

import difflib
import math
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from errno import EINVAL
from pathlib import Path

_MAX_CHARACTERS = 500  # of what a library says, which may be a part of the file


class RenderError(ValueError):
    """Base class: a request to the renderer cannot be carried out.

    Examples
    --------
    >>> from eres_render import Camera
    >>> Camera(1280, 720)
    Traceback (most recent call last):
    eres_render.errors.RenderError: Camera: found neither fov_rad nor fx, expected one of them
    """


class SceneError(RenderError):
    """A scene is unknown, incomplete, or holds a value that is not possible.

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
    eres_render.errors.TrajectoryError: the path lasts from 0 to 10 s; ...
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
    """Turn any failure to read a file into one error that starts with its name.

    What a damaged file makes of a library cannot be listed, so nothing is.
    """
    try:
        yield
    except (RenderError, error) as found:
        named = str(found).startswith(str(file))
        if named and isinstance(found, error):
            raise
        raise error(str(found) if named else f"{file}: {found}") from found
    except FileNotFoundError as found:
        raise error(f"{file}: no such file") from found
    except Exception as found:
        # A damaged offset is EINVAL; libraries that describe the content give no number.
        if isinstance(found, OSError) and found.errno not in (None, EINVAL):
            raise error(f"{file}: cannot be read: {found.strerror}") from found
        raise error(f"{file}: could not be read as {format}: {_reason(found)}") from found


def _reason(found: Exception) -> str:
    """Return what an error says, in one line, or its name."""
    if isinstance(found, RecursionError):
        return "nested too deep"
    return " ".join(str(found).split())[:_MAX_CHARACTERS] or type(found).__name__


def suggestion(name: str, known: Collection[str]) -> str:
    """Return a hint for an unknown name."""
    near = difflib.get_close_matches(name, known, n=2, cutoff=0.5)
    if not near:
        return f"choose from: {', '.join(known)}"
    alike = [difflib.SequenceMatcher(None, one, name).ratio() for one in near]
    as_near = near if alike[-1] > alike[0] - 0.05 else near[:1]
    return f"did you mean {' or '.join(map(repr, as_near))}?"


def check_positive(
    name: str, found: float, error: type[ValueError], expected: str = "a positive number"
) -> None:
    """Refuse a number that is not positive and finite.

    Parameters
    ----------
    expected
        What the value must be, for the error, such as a number with a unit.

    Examples
    --------
    >>> from eres_render.errors import RenderError, check_positive
    >>> check_positive("step_s", 0.05, RenderError)
    >>> check_positive("step_s", 0.0, RenderError)
    Traceback (most recent call last):
    eres_render.errors.RenderError: step_s: found 0.0, expected a positive number
    """
    if not 0 < found < math.inf:
        raise error(f"{name}: found {found}, expected {expected}")


def check_spp(spp: int, error: type[ValueError]) -> None:
    """Refuse a number of samples per pixel that the multijittered sampler cannot lay out.

    Examples
    --------
    >>> from eres_render.errors import RenderError, check_spp
    >>> check_spp(16, RenderError)
    >>> check_spp(5, RenderError)
    Traceback (most recent call last):
    eres_render.errors.RenderError: spp: found 5, expected a square or a grid, such as 4, 6 or 9
    """
    rows = math.isqrt(max(spp, 0))
    if rows == 0 or spp % rows:
        raise error(f"spp: found {spp}, expected a square or a grid, such as 4, 6 or 9")
