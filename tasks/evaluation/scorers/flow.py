"""Optical flow: how far patches move over the window."""

from __future__ import annotations

from collections.abc import Iterator

from sensor import Events
from sensor.events import concatenate
from tasks.evaluation.answers import ask, flow_answer
from tasks.evaluation.reference import ReferenceFrames
from tasks.evaluation.scorers.base import Score
from tasks.evaluation.setting import Setting
from tasks.evaluation.settings import Flow
from tasks.flow import flow_sample, initial_sigma_px, patch_mask, patch_px, rnepe_px
from tasks.methods import load_method
from tasks.variants import NATIVE_PATCH


class FlowScorer:
    """Scores the end-point errors of all features, for each kind of patch."""

    def __init__(self, reference: ReferenceFrames, setting: Setting, task: Flow) -> None:
        self._reference, self._setting, self._task = reference, setting, task
        size = width, height = setting.model.width, setting.model.height
        self._features = reference.features(task.features, task.seed).at(width, height)
        # At 1280 px both patches are the same and are scored once.
        self._variants = {patch_px(width): [""]}
        if task.native_patch:
            self._variants.setdefault(patch_px(width, native=True), []).append(NATIVE_PATCH)
        self._kept = patch_mask(self._features.centers_px, max(self._variants), *size)
        self._parts: list[Events] = []

    def push(self, events: Events) -> None:
        """Keep the window's events in the patches."""
        window = events.between(self._setting.start_us, self._setting.end_us)
        if len(window) or not self._parts:
            self._parts.append(window.where(self._kept[window.y, window.x]))

    def scores(self) -> Iterator[Score]:
        """Yield one score for each kind of patch, feature and method."""
        task, setting, features = self._task, self._setting, self._features
        methods = {name: load_method("flow", name) for name in task.methods}
        initial_px = features.initial_flow_px(task.initial_sigma_px)
        events = concatenate(self._parts)
        self._parts = []
        for side_px, variants in self._variants.items():
            for item in range(len(features)):
                sample = flow_sample(
                    events,
                    setting.start_us,
                    setting.end_us,
                    log_image=self._reference.log_image(setting.model),
                    contrast_threshold=setting.model.contrast_threshold,
                    center_px=features.centers_px[item],
                    side_px=side_px,
                    initial=initial_px[item],
                    initial_sigma_px=initial_sigma_px(features.width, task.initial_sigma_px),
                )
                for name, method in methods.items():
                    answer, cpu_s = ask("flow", name, method, sample)
                    estimate = flow_answer("flow", name, answer, sample.initial)
                    error_px = rnepe_px(estimate.flow, features.flow_px[item], features.width)
                    for variant in variants:
                        yield Score(
                            name,
                            error_px,
                            variant,
                            item,
                            estimate.failure,
                            events=len(sample.t),
                            cpu_s=cpu_s,
                            copied=variant != variants[0],
                        )
