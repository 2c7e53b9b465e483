"""Corners of markers that a camera on a slider sees, with noise; for the tests of the rig."""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from eres_render import Camera
from tasks.rig.bundle import Corners, RigPose
from tasks.rig.page import Page, lay_out
from tasks.rig.settings import PageSettings, SliderSettings
from tasks.rig.slider import Slider, strokes

PAGE = lay_out(
    PageSettings(
        width_m=0.44,
        height_m=0.29,
        picture="pebbles",
        picture_width_m=0.12,
        picture_height_m=0.0675,
        marker_pitch_m=0.034,
    )
)
TRAVEL_M = 0.2
LENS_MM = 8.0


def gen4():
    """A Prophesee Gen4 with an 8 mm lens."""
    return Camera(1280, 720, fx=1e3 * LENS_MM / 4.86)


def davis346():
    """A DAVIS346 with an 8 mm lens."""
    return Camera(346, 260, fx=1e3 * LENS_MM / 18.5)


@dataclass
class Rig:
    """A rig whose truth is known."""

    depth_m: float
    camera: Camera = field(default_factory=gen4)
    page: Page = PAGE
    turn_deg: tuple = (0.5, -0.7, 0.4)
    direction: tuple = (1.0, 0.01, -0.008)
    slider: Slider = field(
        default_factory=lambda: strokes(SliderSettings(travel_m=TRAVEL_M, speeds_mps=(0.2,)))
    )

    @property
    def pose(self) -> RigPose:
        middle = np.array([self.page.width_m / 2, self.page.height_m / 2, -self.depth_m])
        d = np.array(self.direction) / np.linalg.norm(self.direction)
        R = Rotation.from_rotvec(np.deg2rad(self.turn_deg)).as_matrix()
        return RigPose(self.camera, R, middle - 0.5 * TRAVEL_M * d, d)

    def corners(
        self, sigma_px, views=20, seed=0, *, latency_ms=0.0, one_way=False, bias_px=0.0, scale=1.0
    ) -> Corners:
        """Return the corners of all markers in view, at times along the way, with noise."""
        rng = np.random.default_rng(seed)
        t = self.slider.t_us
        times = self.slider.evenly_along(views, t[0], 0.5 * t[-1] if one_way else t[-1])
        size = self.camera.width, self.camera.height
        on_page = self.page.corners()
        t_us, page_m, image_px = [], [], []
        for time in times.astype(float):
            x_m = scale * np.interp(time - 1e3 * latency_ms, t, self.slider.x_m)
            px = self.pose.project(on_page.reshape(-1, 2), x_m).reshape(-1, 4, 2)
            outward = px - px.mean(axis=1, keepdims=True)
            px = px + bias_px * outward / np.linalg.norm(outward, axis=-1, keepdims=True)
            seen = np.all((px > 2) & (px < np.subtract(size, 2)), axis=(1, 2))
            t_us.append(np.full(seen.sum(), time))
            page_m.append(on_page[seen])
            image_px.append(px[seen] + rng.normal(0, sigma_px, px[seen].shape))
        return Corners(*(np.concatenate(one) for one in (t_us, page_m, image_px)))
