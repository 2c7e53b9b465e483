"""The stretches of a path that a study renders."""

import pytest

from eres_render import load_scene
from small_study import only
from tasks.errors import StudyError
from tasks.study.config import PRESETS, Study, Tracking, Video
from tasks.study.run.jobs import jobs_of


def test_only_what_is_scored_is_rendered() -> None:
    """Promise: a study of videos alone has one stretch, and no clips around samples."""
    video = Video(methods=("blank",))
    study = Study(name="video", scenes=("carpet",), evaluate=only(video=video))
    (stretch,) = jobs_of(study, load_scene("carpet"))
    assert stretch.evaluate == {"video": video}
    assert stretch.clip.t_window_end_s == Video().duration_s


def test_a_scene_with_nothing_to_do_is_named() -> None:
    """Promise: a study with only pose tracking in a room, which has no plane, is an error."""
    study = Study(name="pose", scenes=("room",), evaluate=only(tracking=Tracking()))
    with pytest.raises(StudyError, match="no method that suits room"):
        jobs_of(study, load_scene("room"))


def test_the_paper_preset_has_its_jobs() -> None:
    """20 clips on each scene, 20 with a longer warm-up for speed 10, one video on the carpet."""
    paper = PRESETS["paper"]
    counts = [len(jobs_of(paper, load_scene(name))) for name in paper.scenes]
    assert counts == [41, 20, 20]
