"""Errors of the task package; `tasks.cli` prints them as one red line, with exit code 1 or 2."""


class TaskError(ValueError):
    """Base class: a task, a method or a study cannot do what it is asked to do."""


class UsageError(TaskError):
    """A command lacks an argument; the exit code is 2."""


class StudyError(TaskError):
    """A study, preset or run folder is unknown, inconsistent or cannot be used."""


class MethodError(TaskError):
    """A method raised an error, or its answer cannot be scored."""


class ResultError(TaskError):
    """A result file is missing, damaged or of another version."""


class WeightsError(TaskError):
    """A file of network weights is missing, damaged, or from another network."""


class RigError(TaskError):
    """A rig's settings, recording or calibration is wrong, or cannot be solved."""


class TrainingError(TaskError):
    """The settings of a training are wrong, or its folder belongs to another training."""
