"""Errors of the task package; `tasks.cli` turns them into one red line and exit code 1."""


class TaskError(ValueError):
    """Base class: something asked of a task, a method or a study cannot be done."""


class StudyError(TaskError):
    """A study, preset or run folder is unknown, inconsistent or cannot be used."""


class MethodError(TaskError):
    """A method raised, or answered with what its task cannot score."""


class ResultError(TaskError):
    """A result file is missing, damaged or of another version."""
