"""Running a study: jobs, computed here or on a cluster, into a folder."""

from tasks.study.run.run_study import run_study

__all__ = ["run_study"]
