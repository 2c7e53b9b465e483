"""Errors of the render package; each message names the file, the field, found and expected."""

import difflib
from collections.abc import Collection


class RenderError(ValueError):
    """Base class: something asked of the renderer cannot be done."""


class SceneError(RenderError):
    """A scene folder is unknown, incomplete or says something that cannot be."""


class TrajectoryError(RenderError):
    """A camera path is malformed, leaves its scene or is asked for a time it does not cover."""


class SequenceError(RenderError):
    """A radiance sequence on disk is missing, damaged, unfinished or of another version."""


class BackendError(RenderError):
    """No Mitsuba variant that works here can do what was asked."""


def nearest(name: str, known: Collection[str]) -> str:
    """Return a hint for an unknown name: the nearest known one, else all of them."""
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    return f"did you mean {near[0]!r}?" if near else f"choose from: {', '.join(known)}"
