"""The unit of work: one clip's frames through every sensor of the study and every method."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from eres_render import RadianceSequence
from sensor import SensorModel, stream_bank
from tasks.methods import load_method
from tasks.reconstruction import ReconstructionSample, log_white_level, psnr_db
from tasks.row import Row
from tasks.study.config import Study
from tasks.study.scaling import Scaling, interval_histogram, measure_scaling

PREVIEW_S = 0.01  # events of the window's last 10 ms are kept as a picture


@dataclass(frozen=True, eq=False, slots=True)
class ClipResult:
    """Rows of a clip, and what the report shows of it."""

    rows: list[Row]
    keyframe: NDArray[np.float32]  # (H, W) radiance in units of white, at the window's end
    previews: dict[tuple[int, float], NDArray[np.int64]]  # by width, cutoff: (h, w) polarity sums
    scaling: tuple[Scaling, NDArray[np.float64]] | None  # with L_t at the window's end, (H, W), 1/s


@dataclass(frozen=True, slots=True)
class _Setting:
    """A sensor and a speed, and the window in its events' time."""

    model: SensorModel
    speed: float
    start_us: int
    end_us: int


def evaluate_clip(
    study: Study,
    sequence: RadianceSequence,
    on_progress: Callable[[int, int], None],
    *,
    with_scaling: bool,
) -> ClipResult:
    """Simulate every sensor of the study on one sequence, and score every method.

    Parameters
    ----------
    study
        What to simulate and evaluate.
    sequence
        One clip's frames: warm-up, then the window.
    on_progress
        Called after each frame that the sensors have seen, with the number seen and that of all.
    with_scaling
        Whether to measure the scaling statistics too, at the lowest and the highest speed.
    """
    dark_level = study.simulate.dark_fraction * sequence.white_level
    settings = [
        _setting(study, sequence, dark_level, width, cutoff_hz, speed)
        for width, cutoff_hz, speed in product(
            study.simulate.widths, study.simulate.cutoffs_hz, study.simulate.speeds
        )
    ]

    def frames() -> Iterator[NDArray[np.float32]]:
        for k, frame in enumerate(sequence):
            yield frame
            on_progress(k + 1, len(sequence))

    sums = [np.zeros((s.model.height, s.model.width), np.int64) for s in settings]
    counts = [0 for _ in settings]
    previews = {
        (s.model.width, s.model.cutoff_hz): np.zeros_like(total)
        for s, total in zip(settings, sums, strict=True)
    }
    extremes = (min(study.simulate.speeds), max(study.simulate.speeds)) if with_scaling else ()
    histograms = {
        (s.model.width, s.model.cutoff_hz, s.speed): interval_histogram(
            s.model.width, (s.start_us, s.end_us)
        )
        for s in settings
        if s.speed in extremes
    }
    events_of_all = stream_bank(
        frames(), sequence.t_s, [s.model for s in settings], speeds=[s.speed for s in settings]
    )
    for i, events in events_of_all:
        setting = settings[i]
        key = setting.model.width, setting.model.cutoff_hz
        if histogram := histograms.get((*key, setting.speed)):
            histogram.add(events)
        window = events.between(setting.start_us, setting.end_us)
        sums[i] += window.polarity_sum()
        counts[i] += len(window)
        if setting.speed == study.simulate.speeds[0]:
            last = window.between(setting.end_us - round(PREVIEW_S * 1e6), setting.end_us)
            previews[key] += last.polarity_sum()

    start, end = (_frame_at(sequence, t_s) for t_s in sequence.window_s)
    log_keyframe, log_truth = (np.log(f.astype(np.float64) + dark_level) for f in (start, end))
    log_white = log_white_level(log_truth)
    methods = {name: load_method("reconstruction", name) for name in study.evaluate.reconstruction}
    options = {"event_integration": {"upsampling": study.evaluate.upsampling}}

    def score(i: int) -> list[Row]:
        setting = settings[i]
        model = setting.model
        sample = ReconstructionSample(
            log_keyframe, sums[i].astype(np.float64), model.contrast_threshold
        )
        seconds = (setting.end_us - setting.start_us) * 1e-6
        return [
            Row(
                scene=sequence.manifest.scene,
                task="reconstruction",
                method=name,
                width=model.width,
                cutoff_hz=model.cutoff_hz,
                speed=setting.speed,
                sample=sequence.manifest.clip,
                metric="psnr_db",
                value=psnr_db(method(sample, **options.get(name, {})), log_truth, log_white),
                event_rate_hz=counts[i] / seconds,
            )
            for name, method in methods.items()
        ]

    with ThreadPoolExecutor() as workers:
        rows = [row for part in workers.map(score, range(len(settings))) for row in part]
    scaling = measure_scaling(sequence, dark_level, histograms) if with_scaling else None
    return ClipResult(rows, end / np.float32(np.exp(log_white)), previews, scaling)


def _setting(
    study: Study,
    sequence: RadianceSequence,
    dark_level: float,
    width: int,
    cutoff_hz: float,
    speed: float,
) -> _Setting:
    model = SensorModel(
        width=width,
        height=width,
        contrast_threshold=study.simulate.contrast_threshold,
        cutoff_hz=cutoff_hz,
        dark_level=dark_level,
    )
    start_us, end_us = (round(t_s / speed * 1e6) for t_s in sequence.window_s)
    return _Setting(model, speed, start_us, end_us)


def _frame_at(sequence: RadianceSequence, t_s: float) -> NDArray[np.float32]:
    return sequence.frame(int(np.searchsorted(sequence.t_s, t_s)))
