"""The studies of the runs in docs/results."""

from functools import reduce

from tasks.study.config import Study, preset, with_method

PAPER_METHODS = (
    *("our_reconstruction_all_light", "our_reconstruction_ideal_light"),
    *("our_flow_all_light", "our_flow_ideal_light", "zero_flow"),
)


def paper_study() -> Study:
    """Return the study of docs/results/paper: the preset, and our networks."""
    return reduce(with_method, PAPER_METHODS, preset("paper"))
