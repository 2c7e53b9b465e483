"""Judge the widths that `eres advise --image` chooses, on photographs that move past sensors.

    python benchmarks/lag_image.py FOLDER
    python benchmarks/lag_image.py FOLDER --only MtTamWest --threshold 0.02 --contrast 0.1

reads the photographs of `PHOTOGRAPHS` in a folder, and downloads those that it lacks. Each is cut
to a square, averaged to 480 px and continued by its mirror image. It moves in five directions, so
fast that the lag is 0.2 to 6 px of the finest of three sensors, of 480, 240 and 120 px. The random
textures of lag_textures.py, of 256 px, do the same before sensors of 256, 128 and 64 px. Each case
is simulated and scored, and compared with what the first image of its window predicts.

It prints Markdown tables: by rule, how much worse than the best of the three widths its choice is;
by image, the same of the prediction, how often it ranks neighboring widths as the simulation does,
and the error of their margins; and the worst cases. Options change the sensor and the contrast, to
see what errors are due to: a small threshold has no memory, and of a small contrast the logarithm
is linear.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import math
import sys
import urllib.request
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from lag_textures import texture
from numpy.typing import NDArray

from sensor import SensorModel, simulate
from sensor.optics import integrate
from tasks.advice.law import chosen
from tasks.advice.spectrum import MovingImage
from tasks.footage.images import read_images
from tasks.footage.luminance import Luminance, coding_of
from tasks.methods.event_integration import reconstruct
from tasks.reconstruction import ReconstructionSample, log_white_level, psnr_db

_EXR = "AcademySoftwareFoundation/openexr-images", "e38ffb0790f62f05a6f083a6fa4cac150b3b7452"
_SKIMAGE = "scikit-image/scikit-image", "cd0a3d22b9f359f05618d75d5c7a29b91b4951ca"
PHOTOGRAPHS = (  # repository, commit, path, license, start of its SHA-256
    (*_EXR, "LuminanceChroma/CrissyField.exr", "BSD-3-Clause", "5a1b2ca1a716"),
    (*_EXR, "LuminanceChroma/Flowers.exr", "BSD-3-Clause", "d1016a9177e7"),
    (*_EXR, "MultiView/Adjuster.exr", "BSD-3-Clause", "966aa7bbdaec"),
    (*_EXR, "ScanLines/Cannon.exr", "BSD-3-Clause", "1ac7ae21c22f"),
    (*_EXR, "ScanLines/Desk.exr", "BSD-3-Clause", "2734d15e1ce1"),
    (*_EXR, "ScanLines/MtTamWest.exr", "BSD-3-Clause", "95731ce47498"),
    (*_EXR, "ScanLines/StillLife.exr", "BSD-3-Clause", "86a04a36ec10"),
    (*_EXR, "ScanLines/Tree.exr", "BSD-3-Clause", "8397741de996"),
    (*_EXR, "Tiles/GoldenGate.exr", "BSD-3-Clause", "8790ad440e87"),
    (*_SKIMAGE, "src/_skimage2/data/astronaut.png", "public domain", "88431cd9653c"),
    (*_SKIMAGE, "src/_skimage2/data/motorcycle_left.png", "no restrictions", "db18e9c41576"),
    (*_SKIMAGE, "src/_skimage2/data/retina.jpg", "CC0-1.0", "38a07f36f27f"),
)
TEXTURES = "all directions", "stripes", "courses"
SEEDS = range(2)
LAGS_PX = (0.2, 0.35, 0.6, 1.0, 1.6, 2.5, 4.0, 6.0)  # of the finest
STEPS = (2, 0), (0, 2), (1, 1), (2, 1), (-1, 2)  # x and y between two frames, quarters of a px
_SIDE = 480
_WINDOW_PX = 30.0
_SPEED_PX_S = 1000.0
_DARK = 1e-3  # of white
_WARM_UP = 8.0  # time constants


class Case(NamedTuple):
    """One image in one motion before one sensor of three widths."""

    image: str
    step: tuple[int, int]
    lag_px: float  # of the finest
    psnr_db: tuple[float, ...]  # by width, from the coarsest
    predicted_db: tuple[float, ...]

    def regret(self, choice: int) -> float:
        """Return how much worse than the best a width is, dB."""
        return max(self.psnr_db) - self.psnr_db[choice]

    def choices(self) -> dict[str, int]:
        """Return the index of the width that each rule chooses."""
        lags = [self.lag_px / 4, self.lag_px / 2, self.lag_px]
        by_image = int(np.argmax(self.predicted_db))
        return {
            "the image": by_image,
            "1 px": chosen(lags),
            "finest": 2,
            "middle": 1,
            "coarsest": 0,
        }

    def margin_errors(self) -> NDArray[np.float64]:
        """Return by how much predicted margins between neighboring widths differ, dB."""
        return np.diff(self.predicted_db) - np.diff(self.psnr_db)


class Track:
    """Views of a periodic image of log light, a quarter of a pixel apart."""

    def __init__(self, log_light: NDArray[np.float64], side: int) -> None:
        self._spectrum, self._side = np.fft.rfft2(log_light), side
        self._period = log_light.shape[0]
        self.phase = cache(self._phase)

    def _phase(self, x: int, y: int) -> NDArray[np.float32]:
        kx, ky = np.fft.rfftfreq(self._period), np.fft.fftfreq(self._period)[:, None]
        moved = self._spectrum * np.exp(2j * np.pi * (kx * x + ky * y) / 4)
        return np.exp(np.fft.irfft2(moved, s=(self._period,) * 2)).astype(np.float32)

    def frames(self, step: tuple[int, int], count: int) -> NDArray[np.float32]:
        """Return frames of linear light, (T, H, W)."""
        pixels, views = np.arange(self._side), []
        for k in range(count):
            (x, x_phase), (y, y_phase) = (divmod(k * one, 4) for one in step)
            rows, columns = ((pixels + one) % self._period for one in (y, x))
            views.append(self.phase(x_phase, y_phase)[np.ix_(rows, columns)])
        return np.stack(views)


def photograph(folder: Path, entry: tuple[str, ...], contrast: float) -> Track:
    """Read a photograph, or download it; its log light is multiplied by a contrast."""
    repository, commit, path, _, digest = entry
    file = folder / Path(path).name
    if not file.exists():
        url = f"https://raw.githubusercontent.com/{repository}/{commit}/{path}"
        urllib.request.urlretrieve(url, file)
    if not hashlib.sha256(file.read_bytes()).hexdigest().startswith(digest):
        sys.exit(f"error: {file}: is not {path} of {repository}")
    coded = next(read_images([file]))
    encoding, white = coding_of(coded, None, "srgb", file)
    light = np.maximum(Luminance(encoding, white)(file, coded) / white, 0)
    side = min(light.shape)
    top, left = ((size - side) // 2 for size in light.shape)
    averaged = integrate(light[top : top + side, left : left + side], _SIDE, _SIDE)
    quarter = contrast * np.log(averaged + _DARK)
    half = np.hstack([quarter, quarter[:, ::-1]])
    return Track(np.vstack([half, half[::-1]]), _SIDE)


def tracks(folder: Path, only: list[str], contrast: float) -> Iterator[tuple[str, Track]]:
    """Yield each image with its name."""
    for entry in PHOTOGRAPHS:
        if (name := Path(entry[2]).stem) in only or not only:
            yield name, photograph(folder, entry, contrast)
    for kind, seed in itertools.product(TEXTURES, SEEDS):
        if (name := f"{kind} {seed}") in only or not only:
            log_light = contrast * np.fft.ifft2(texture(kind, seed)).real
            yield name, Track(log_light, len(log_light))


def cases_of(name: str, track: Track, threshold: float, photoreceptor: str) -> Iterator[Case]:
    """Yield the simulated cases of an image."""
    poles = 2 if photoreceptor == "two_pole" else 1
    for step in STEPS:
        apart = math.hypot(*step) / 4
        inside = round(_WINDOW_PX / apart)
        passed = {lag: math.ceil((_WARM_UP * lag / poles + 3) / apart) for lag in LAGS_PX}
        longest = track.frames(step, max(passed.values()) + inside + 1)
        degrees = math.degrees(math.atan2(step[1], step[0]))
        for lag, warm_up in passed.items():
            frames = longest[: warm_up + inside + 1]
            first, last = (np.log(frames[k].astype(np.float64)) for k in (warm_up, -1))
            white = log_white_level(first)
            moving = MovingImage(np.minimum(np.exp(first - white), 1), inside * apart, degrees)
            t_s = np.arange(len(frames)) * apart / _SPEED_PX_S
            ends_us = round(1e6 * t_s[warm_up]), round(1e6 * t_s[-1]) + 1
            found, predicted = [], []
            for width in (len(first) // 4, len(first) // 2, len(first)):
                model = SensorModel(
                    width=width,
                    height=width,
                    contrast_threshold=threshold,
                    photoreceptor=photoreceptor,  # type: ignore[arg-type]
                    cutoff_hz=poles * _SPEED_PX_S / (2 * math.pi * lag),
                    dark_level=0,
                    random_start=True,
                )
                events = simulate(frames, t_s, model, seed=0).between(*ends_us)
                sums = events.polarity_sum().astype(np.float64)
                image = reconstruct(ReconstructionSample(first, sums, threshold))
                found.append(psnr_db(image, last, white))
                predicted += moving.psnr_db(width, [lag], threshold, poles)
            yield Case(name, step, lag, tuple(found), tuple(predicted))


def print_rules(cases: list[Case]) -> None:
    """Print the regret of each rule."""
    print("\n| rule | cases | mean regret, dB | median | 90 % below | worst |")
    print("|---|---|---|---|---|---|")
    for rule in cases[0].choices():
        regrets = [case.regret(case.choices()[rule]) for case in cases]
        cells = np.mean(regrets), np.median(regrets), *np.percentile(regrets, (90, 100))
        print(f"| {rule} | {len(cases)} | {' | '.join(f'{one:.3f}' for one in cells)} |")


def print_images(cases: list[Case]) -> None:
    """Print the regret and the errors of the spectrum by image, and its worst cases."""
    print("\n| image | mean regret, dB | worst | of 1 px | pairs right | error of margins, dB |")
    print("|---|---|---|---|---|---|")
    for name in dict.fromkeys(case.image for case in cases):
        inside = [case for case in cases if case.image == name]
        regrets, others = (
            [case.regret(case.choices()[rule]) for case in inside] for rule in ("the image", "1 px")
        )
        right = [
            np.sign(np.diff(case.predicted_db)) == np.sign(np.diff(case.psnr_db)) for case in inside
        ]
        errors = np.abs([case.margin_errors() for case in inside])
        print(
            f"| {name} | {np.mean(regrets):.3f} | {max(regrets):.2f} | {max(others):.2f} "
            f"| {100 * np.mean(right):.0f} % | {np.mean(errors):.2f} |"
        )
    print("\n| image | step | lag, px | PSNR, dB | predicted | regret |\n|---|---|---|---|---|---|")
    for case in sorted(cases, key=lambda one: -one.regret(one.choices()["the image"]))[:12]:
        psnr, predicted = (
            ", ".join(f"{one:.2f}" for one in each) for each in (case.psnr_db, case.predicted_db)
        )
        regret = case.regret(case.choices()["the image"])
        print(
            f"| {case.image} | {case.step} | {case.lag_px} | {psnr} | {predicted} | {regret:.2f} |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path, help="folder of the photographs")
    parser.add_argument("--threshold", type=float, default=0.2, help="log units")
    parser.add_argument("--photoreceptor", default="two_pole", choices=("two_pole", "one_pole"))
    parser.add_argument("--contrast", type=float, default=1.0, help="factor on the log light")
    parser.add_argument("--only", nargs="+", default=[], help="names of images")
    given = parser.parse_args()
    cases = []
    for name, track in tracks(given.folder, given.only, given.contrast):
        cases += cases_of(name, track, given.threshold, given.photoreceptor)
    textures = [case for case in cases if case.image.rstrip(" 0123456789") in TEXTURES]
    photographs = [case for case in cases if case not in textures]
    for each in filter(None, (photographs, textures)):
        print_rules(each)
    print_images(cases)


if __name__ == "__main__":
    main()
