"""Errors of the render package; each message names the file, the field, found and expected."""


class RenderError(ValueError):
    """Base class: the renderer cannot do something."""


class SceneError(RenderError):
    """A scene is unknown, incomplete or contradicts itself."""


class TrajectoryError(RenderError):
    """A camera path is malformed, leaves its scene or is asked for a time it does not cover."""


class SequenceError(RenderError):
    """A radiance sequence on disk is missing, damaged, unfinished or of another version."""


class BackendError(RenderError):
    """No Mitsuba variant that works on this machine can do something."""
