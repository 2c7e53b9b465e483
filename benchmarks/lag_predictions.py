"""Predict by the lag law which of two widths wins on scenes it has not seen, then measure it.

    python benchmarks/lag_predictions.py fetch     # the scenes and textures, of other people
    python benchmarks/lag_predictions.py predict   # wrote docs/predictions/lag.toml; without light
    python benchmarks/lag_predictions.py measure   # writes docs/predictions/lag.csv
    python benchmarks/lag_predictions.py image     # the same for the spectrum of an image
    python benchmarks/lag_predictions.py           # prints the tables of docs/lag_tests.md

`predict` traces the distance of surfaces, and no light: the speed of the image is the median length
of the true flow of the pixels that stay in view over a window. `measure` keeps the paths that were
measured before; no table is printed if the predictions were changed since. *Detail* came after the
measurement, to tell why a scene differs: see `detail_speed`.

Rooms are scenes of Mitsuba 0.6. Here each surface has its diffuse reflectance, at least 3 %, and
all are in an even light, (3 + up) / 4, in which up is the upward part of the normal: it needs no
path tracing, whose noise would cause events. Glass is left out; the sky is 1. Planes are
photographs.
"""

from __future__ import annotations

import csv
import hashlib
import itertools
import math
import subprocess
import sys
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from lag_law import share, table
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eres_render import Camera, GroundTruth, Trajectory, path_through
from eres_render.rendering.backend import select_variant
from eres_render.rendering.raycast import RayCaster
from eres_render.storage.atomic import write_text
from eres_render.storage.cache import cache_dir
from eres_render.trajectory.frame_times import adaptive_times, depth_image_motion
from sensor import SensorModel, stream_bank
from sensor.levels import DARK_SHARE, white_level
from tasks.advice.law import CROSSING_PX, NEAR_PX, finer_wins
from tasks.advice.spectrum import MovingImage
from tasks.advice.stored import Window
from tasks.methods.event_integration import reconstruct
from tasks.reconstruction import ReconstructionSample, log_white_level, psnr_db

FOLDER = Path(__file__).parents[1] / "docs" / "predictions"
FROZEN, MEASURED = FOLDER / "lag.toml", FOLDER / "lag.csv"
WIDTHS = (80, 160, 320)
THRESHOLDS = (0.1, 0.2, 0.4)
LAGS_PX = (0.4, 0.75, 0.95, 1.2, 1.6, 2.2, 3.2, 6.0)  # of the finest, times a factor by path
SPREAD = (0.85, 1.15)
WINDOW_PX, WARM_UP_PX, WINDOWS = 30.0, 36.0, 2
STEP_PX, SPP = 0.5, 16
DARKEST = 0.03  # reflectance; some surfaces of the rooms have none
ONE_POLE_PX = 3.0  # crossing with one pole, in px of v / (2 pi f)
FINER, TIE, COARSER, WITHIN = "+", "=", "-", "~"
LOW, HIGH = NEAR_PX
NEARLY_DB = 0.1
COHERENT = 0.7  # mean flow over mean length, above which an image has one direction
RIGHT_SHARE, MEDIAN_REGRET_DB = 0.85, 0.2
HEADER = f"""\
# Predictions of the lag law, made before any light of these scenes was computed.
# `python benchmarks/lag_predictions.py predict` wrote this file. It must not change.
#
# The law is false if, in one of the scenes,
# - it is right in less than {RIGHT_SHARE:.0%} of the cases of two poles outside {LOW} to {HIGH} px,
#   all contrast thresholds together, or
# - the median regret of following it with two poles, over windows, cutoffs and thresholds, is above
#   {MEDIAN_REGRET_DB} dB.
# Reported whatever comes: the share right by scene outside these lags; the worst scene; the mean,
# median and worst regret of the law, of always taking the finest width, and of always taking the
# middle one, for each threshold; the same for one pole.
#
# A case is a pair of widths, 320 over 160 px or 160 over 80 px, in a window, with a cutoff, a
# photoreceptor and a threshold of 0.1, 0.2 or 0.4. Its lag is v / (pi f) px of the finer width with
# two poles, and v / (2 pi f) with one. Its speed v is the median length of the true flow of the
# pixels that stay in view over the window. The prediction does not depend on the threshold:
# - two poles: "+" the finer wins, below {LOW} px; "=" undecided; "-" the coarser wins, above
#   {HIGH} px.
# - one pole, whose crossing is predicted at {ONE_POLE_PX:g} px: "+" the finer wins, below
#   {ONE_POLE_PX * LOW:.1f} px; "=" undecided; "~" the finer loses less than {NEARLY_DB} dB, above
#   {ONE_POLE_PX * HIGH:.1f} px.
# The rule whose regret counts goes from the coarsest width on to the next finer one, as long as the
# lag of that one is below {CROSSING_PX:g} px with two poles, and below {ONE_POLE_PX:g} px with one.
"""


@dataclass(frozen=True)
class Source:
    """A repository at a commit."""

    url: str
    commit: str


SCENES_OF_MITSUBA = Source(
    "https://github.com/hchoi405/dppm-scenes", "8fdb2dcb3fe575bb04bc586fded35e81d76787d5"
)
PLAYCANVAS = Source(
    "https://github.com/playcanvas/engine", "0aaef5e432c4797ed23c1f966e2cc43232ec0613"
)
SCIKIT_IMAGE = Source(
    "https://github.com/scikit-image/scikit-image", "cd0a3d22b9f359f05618d75d5c7a29b91b4951ca"
)


@dataclass(frozen=True)
class Motion:
    """How a camera moves from its place, in its own axes: right, down, ahead."""

    px_s: float  # median speed of the image to begin with, of 320 px
    move: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m per unit
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)  # rotation vector, rad per unit
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m


@dataclass(frozen=True)
class Place:
    """A scene of other people's, and two motions in it."""

    source: Source
    path: str  # of scene.xml or of an image
    license: str
    motions: tuple[Motion, Motion]
    side_m: float = 0.0  # of an image's width, 1 m before the camera

    @property
    def is_room(self) -> bool:
        return self.path.endswith(".xml")


PLACES = {
    "classroom": Place(
        SCENES_OF_MITSUBA,
        "scenes/classroom/scene.xml",
        "Japanese Classroom by NovaZeeke, CC-BY 3.0",
        (
            Motion(300, move=(-1, 0, 0), turn=(0, -0.15, 0)),
            Motion(220, move=(0.2, -0.1, 1), turn=(0, 0.15, 0)),
        ),
    ),
    "living_room": Place(
        SCENES_OF_MITSUBA,
        "scenes/living-room/scene.xml",
        "The Grey & White Room by Wig42, CC-BY 3.0",
        (Motion(260, move=(0.9, 0, 0.4), turn=(0, 0.15, 0)), Motion(420, turn=(0.3, 1, 0.1))),
    ),
    "staircase": Place(
        SCENES_OF_MITSUBA,
        "scenes/staircase/scene.xml",
        "The Wooden Staircase by Wig42, CC-BY 3.0",
        (
            Motion(350, move=(0.7, 0.2, 0), turn=(0, 0.1, 0)),
            Motion(180, move=(-0.2, 0, 1), turn=(0, -0.1, 0)),
        ),
    ),
    "trail": Place(
        PLAYCANVAS,
        "examples/assets/textures/rocky_trail_diff_1k.jpg",
        "Rocky Trail of Poly Haven, CC0; the repository MIT",
        (Motion(320, move=(1, 0, 0)), Motion(240, move=(-0.5, 0.9, 0), turn=(0, 0, 0.2))),
        side_m=2.2,
    ),
    "tissue": Place(
        SCIKIT_IMAGE,
        "src/_skimage2/data/ihc.png",
        "Stained colon tissue, no known restrictions; the repository BSD-3",
        (Motion(280, move=(0, 1, 0)), Motion(400, move=(0.9, -0.4, 0.1))),
        side_m=1.85,
    ),
    "canyon": Place(
        PLAYCANVAS,
        "examples/assets/textures/terrain/Canyon-Diffuse.jpg",
        "Canyon and River of Motion Forge Pictures, CC0; the repository MIT",
        (Motion(360, move=(0.7, 0.7, 0)), Motion(200, move=(-1, 0.1, 0), turn=(0.02, 0, 0))),
        side_m=2.6,
    ),
    "boulder_turning": Place(
        PLAYCANVAS,
        "examples/assets/textures/rock_boulder_cracked_diff_1k.jpg",
        "Rock Boulder Cracked of Poly Haven, CC0; the repository MIT",
        (Motion(250, turn=(0, 0, 1)), Motion(330, turn=(0.3, 1, 0.5), start=(-0.25, 0, 0))),
        side_m=2.6,
    ),
    "aerial_looming": Place(
        PLAYCANVAS,
        "examples/assets/textures/aerial_rocks_02_diff_1k.jpg",
        "Aerial Rocks 02 of Poly Haven, CC0; the repository MIT",
        (
            Motion(160, move=(0, 0, 1), start=(0, 0, -0.5)),
            Motion(300, move=(0.15, 0.1, -1), start=(0.05, 0, 0.3)),
        ),
        side_m=2.2,
    ),
}


def fetched(source: Source) -> Path:
    """Return the folder of a repository's files."""
    return cache_dir() / "lag_predictions" / source.commit


def fetch() -> None:
    """Fetch the files of all places with git, and only these."""
    for source in dict.fromkeys(place.source for place in PLACES.values()):
        folder = fetched(source)
        folder.mkdir(parents=True, exist_ok=True)
        own = [place for place in PLACES.values() if place.source == source]
        paths = [f"/{Path(p.path).parent if p.is_room else p.path}" for p in own]
        for command in (
            ("init", "-q"),
            ("config", "remote.origin.url", source.url),
            ("config", "remote.origin.promisor", "true"),
            ("config", "remote.origin.partialclonefilter", "blob:none"),
            ("fetch", "-q", "--depth=1", "--filter=blob:none", "origin", source.commit),
            ("sparse-checkout", "set", "--no-cone", *paths),
            ("checkout", "-q", source.commit),
        ):
            subprocess.run(["git", "-C", str(folder), *command], check=True)
        print(folder)


class World:
    """A place with its surfaces, the camera of its two motions, and its light if asked for."""

    def __init__(self, place: Place) -> None:
        import mitsuba as mi

        select_variant()
        file = fetched(place.source) / place.path
        if place.is_room:
            self.fov_deg, self.T_world_cam, self.scene = _room(file)
        else:
            self.fov_deg, self.scene = 60.0, mi.load_dict(_plane(file, place.side_m))
            self.T_world_cam = np.diag([1.0, -1.0, -1.0, 1.0])  # 1 m above, looks down
            self.T_world_cam[2, 3] = 1.0
        self.camera = Camera(WIDTHS[-1], WIDTHS[-1], math.radians(self.fov_deg))
        self.caster = RayCaster(self.scene)

    def path(self, motion: Motion, rate: float, duration_s: float) -> Trajectory:
        """Return the path of a motion at a rate, units per s."""
        t_s = np.linspace(0, duration_s, 9)
        poses = np.tile(np.eye(4), (len(t_s), 1, 1))
        units = rate * t_s[:, None]
        poses[:, :3, :3] = Rotation.from_rotvec(units * motion.turn).as_matrix()
        poses[:, :3, 3] = np.array(motion.start) + units * motion.move
        return path_through(t_s, self.T_world_cam @ poses)

    def truth(self, path: Trajectory) -> GroundTruth:
        """Return the ground truth on a path."""
        return GroundTruth(path, self.camera, self.caster.distance)

    def times(self, path: Trajectory, marks_s: list[float]) -> NDArray[np.float64]:
        """Return frame times between which no point moves by more than half a pixel."""

        def inverse_depth(T: NDArray[np.float64], points_px: NDArray[np.float64]) -> Any:
            return 1 / self.caster.distance(T[:3, 3], self.camera.rays(points_px) @ T[:3, :3].T)

        return adaptive_times(
            depth_image_motion(path, self.camera, inverse_depth), marks_s, STEP_PX
        )

    def light(self) -> Callable[[NDArray[np.float64]], NDArray[np.float32]]:
        """Return what renders the light seen from a pose, (H, W)."""
        import drjit as dr
        import mitsuba as mi

        class EvenLight(mi.SamplingIntegrator):
            def sample(
                self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True
            ) -> tuple[Any, Any, list[Any]]:
                si = scene.ray_intersect(ray, active)
                hit = si.is_valid()
                toward = dr.mulsign(si.n, -dr.dot(si.n, ray.d))  # the side in view
                reflectance = si.bsdf(ray).eval_diffuse_reflectance(si, hit)
                reflectance = dr.maximum(reflectance, DARKEST)
                return dr.select(hit, reflectance * (0.75 + 0.25 * toward.y), 1.0), hit, []

        film = {"type": "hdrfilm", "width": WIDTHS[-1], "height": WIDTHS[-1]}
        film |= {"rfilter": {"type": "box"}, "pixel_format": "luminance"}
        kind = {"type": "perspective", "fov": self.fov_deg, "near_clip": 1e-3, "film": film}
        sampler = {"type": "multijitter", "sample_count": SPP}
        integrator = EvenLight(mi.Properties())

        def frame(T_world_cam: NDArray[np.float64]) -> NDArray[np.float32]:
            to_world = mi.ScalarTransform4f(T_world_cam @ np.diag([-1.0, -1.0, 1.0, 1.0]))
            sensor = mi.load_dict(kind | {"sampler": sampler, "to_world": to_world})
            image = mi.render(self.scene, sensor=sensor, integrator=integrator, seed=0, spp=SPP)
            return np.asarray(image, np.float32)[:, :, 0]

        return frame


def _plane(file: Path, side_m: float) -> dict[str, Any]:
    import mitsuba as mi

    columns, rows = mi.Bitmap(str(file)).size()
    size = mi.ScalarTransform4f().scale([0.5 * side_m, 0.5 * side_m * rows / columns, 1.0])
    texture = {"type": "bitmap", "filename": str(file), "wrap_mode": "mirror"}
    bsdf = {"type": "diffuse", "reflectance": texture}
    return {"type": "scene", "plane": {"type": "rectangle", "to_world": size, "bsdf": bsdf}}


def _room(file: Path) -> tuple[float, NDArray[np.float64], Any]:
    """Return the field of view and the pose of a room's own camera, and its surfaces."""
    import mitsuba as mi

    root = ET.parse(file).getroot()
    sensor = root.find("sensor")
    assert sensor is not None
    fov_deg = float(sensor.find("float[@name='fov']").attrib["value"])
    matrix = sensor.find("transform/matrix").attrib["value"].split()
    T_world_cam = np.array(matrix, np.float64).reshape(4, 4) @ np.diag([-1.0, -1.0, 1.0, 1.0])
    clear = set()
    for bsdf in root.findall("bsdf"):
        if any("dielectric" in each.get("type", "") for each in bsdf.iter("bsdf")):
            clear |= {each.get("id") for each in bsdf.iter("bsdf")} - {None}
    for child in list(root):
        ref = child.find("ref")
        glass = child.tag == "shape" and ref is not None and ref.get("id") in clear
        if child.tag in ("integrator", "sensor", "emitter") or glass or child.get("id") in clear:
            root.remove(child)
        elif child.tag == "bsdf":
            _make_diffuse(child)
        elif child.tag == "shape":
            for emitter in child.findall("emitter"):
                child.remove(emitter)
            for bsdf in child.findall("bsdf"):
                _make_diffuse(bsdf)
    plain = file.with_name("even.xml")
    ET.ElementTree(root).write(plain)
    return fov_deg, T_world_cam, mi.load_file(str(plain))


def _make_diffuse(bsdf: ET.Element) -> None:
    """Leave a material its diffuse reflectance, or half where it has none, and its id."""
    ids = [each.get("id", "") for each in bsdf.iter("bsdf") if each.get("id")]
    names = "reflectance", "diffuseReflectance"
    colors = [each for each in bsdf.iter() if each.get("name") in names]
    color = colors[0] if colors else ET.Element("rgb", value="0.5")
    color.set("name", "reflectance")
    for child in color.findall("string"):
        if child.get("name") != "filename":
            color.remove(child)
    for child in list(bsdf):
        bsdf.remove(child)
    bsdf.attrib.clear()
    bsdf.attrib.update({"type": "twosided"} | ({"id": ids[0]} if ids else {}))
    ET.SubElement(bsdf, "bsdf", type="diffuse").append(color)


def marks_of(motion: Motion) -> list[float]:
    """Return the start of a path, and the start and end of its windows, s."""
    warm_up_s = round(WARM_UP_PX / motion.px_s, 4)
    window_s = round(WINDOW_PX / motion.px_s, 4)
    return [0.0, *(warm_up_s + k * window_s for k in range(WINDOWS + 1))]


def predictions(v_px_s: float, cutoffs_hz: list[float], poles: int) -> Iterator[list[str]]:
    """Yield what is predicted at each cutoff, for each width above the coarsest."""
    crossing, beyond = (CROSSING_PX, COARSER) if poles == 2 else (ONE_POLE_PX, WITHIN)
    low, high = (crossing * edge for edge in NEAR_PX)
    for width in WIDTHS[1:]:
        lags = [lag_px(v_px_s * width / WIDTHS[-1], f, poles) for f in cutoffs_hz]
        yield [FINER if lag < low else TIE if lag <= high else beyond for lag in lags]


def lag_px(v_px_s: float, cutoff_hz: float, poles: int) -> float:
    """Return the lag of poles, px: each delays by 1 / (2 pi f)."""
    return poles * v_px_s / (2 * math.pi * cutoff_hz)


def predict() -> None:
    """Write the file of predictions; it takes distances, and no light."""
    if FROZEN.exists():
        sys.exit(f"error: {FROZEN}: exists, and must not change")
    factors = np.random.default_rng(0).uniform(*SPREAD, (len(PLACES), 2))
    parts = [HEADER]
    for (name, place), row in zip(PLACES.items(), factors, strict=True):
        world = World(place)
        parts.append(
            f'\n[{name}]\nrepository = "{place.source.url}"\ncommit = "{place.source.commit}"\n'
            f'file = "{place.path}"\nlicense = "{place.license}"\n'
        )
        for motion, factor in zip(place.motions, row, strict=True):
            marks_s = marks_of(motion)
            brief_s = 1e-3
            brief = world.truth(world.path(motion, 0.05, marks_s[-1])).flow(0, brief_s, WIDTHS[-1])
            unit_px_s = _median_px(brief) / (0.05 * brief_s)
            rate = float(f"{motion.px_s / unit_px_s:.2g}")
            path = world.path(motion, rate, marks_s[-1])
            truth = world.truth(path)
            v_px_s = [
                round(_median_px(truth.flow(a, b, WIDTHS[-1])) / (b - a), 1)
                for a, b in itertools.pairwise(marks_s[1:])
            ]
            v = float(np.mean(v_px_s))
            two = [float(f"{v / (math.pi * factor * lag):.2g}") for lag in LAGS_PX]
            frames = len(world.times(path, marks_s))
            parts.append(
                f"\n[[{name}.path]]\nmove = {list(motion.move)}\nturn = {list(motion.turn)}\n"
                f"start = {list(motion.start)}\nunits_per_s = {rate}\nmarks_s = {marks_s}\n"
                f"frames = {frames}\nv_px_s = {v_px_s} # of 320 px, by window\n"
            )
            for poles, cutoffs in ((2, two), (1, [f / 2 for f in two])):
                parts.append(f"cutoffs_hz_{poles} = {cutoffs}\n")
                for k, each in enumerate(v_px_s):
                    for width, signs in zip(
                        WIDTHS[1:], predictions(each, cutoffs, poles), strict=True
                    ):
                        parts.append(f'window_{k}_poles_{poles}_{width} = "{"".join(signs)}"\n')
        print(name, flush=True)
    FOLDER.mkdir(exist_ok=True)
    write_text(FROZEN, "".join(parts))


def _median_px(flow: Any) -> float:
    return float(np.median(np.linalg.norm(flow.flow_px[flow.valid], axis=-1)))


def frozen_digest() -> str:
    """Return the hash of the file of predictions."""
    return hashlib.sha256(FROZEN.read_bytes()).hexdigest()


def models_of(path: dict[str, Any], dark_level: float) -> dict[tuple[Any, ...], SensorModel]:
    """Return the sensors of a path by poles, cutoff, threshold and width."""
    names = {2: "two_pole", 1: "one_pole"}
    return {
        (poles, cutoff, C, width): SensorModel(
            width=width,
            height=width,
            contrast_threshold=C,
            photoreceptor=names[poles],  # type: ignore[arg-type]
            cutoff_hz=cutoff,
            dark_level=dark_level,
            random_start=True,
        )
        for poles in names
        for cutoff in path[f"cutoffs_hz_{poles}"]
        for C in THRESHOLDS
        for width in WIDTHS
    }


def measure_path(world: World, path: dict[str, Any], seed: int) -> dict[str, NDArray[Any]]:
    """Return the PSNR of each window and sensor, dB, and the images and flow of the windows."""
    marks_s = path["marks_s"]
    motion = Motion(0.0, *(tuple(path[key]) for key in ("move", "turn", "start")))
    trajectory = world.path(motion, path["units_per_s"], marks_s[-1])
    t_s = world.times(trajectory, marks_s)
    frame, poses = world.light(), trajectory.pose(t_s)
    white = float(np.percentile(frame(poses[0]), 99.9))
    models = models_of(path, DARK_SHARE * white)
    at = np.searchsorted(t_s, np.array(marks_s[1:]) - 1e-9)
    ends_us = [round(1e6 * t_s[k]) for k in at]
    kept: dict[int, NDArray[np.float64]] = {}

    def frames() -> Iterator[NDArray[np.float32]]:
        for k, pose in enumerate(poses):
            light = frame(pose)
            if k in at:
                kept[k] = np.log(light.astype(np.float64) + DARK_SHARE * white)
            yield light

    sums = [np.zeros((WINDOWS, m.height, m.width)) for m in models.values()]
    for i, events in stream_bank(frames(), t_s, [*models.values()], seed=seed):
        for k, (a, b) in enumerate(itertools.pairwise(ends_us)):
            sums[i][k] += events.between(a + 1, b + 1).polarity_sum()
    images = [kept[k] for k in at]
    psnr = np.zeros((WINDOWS, len(models)))
    for i, (_, _, C, _) in enumerate(models):
        for k, (first, last) in enumerate(itertools.pairwise(images)):
            image = reconstruct(ReconstructionSample(first, sums[i][k], C))
            psnr[k, i] = psnr_db(image, last, log_white_level(first))
    truth = world.truth(trajectory)
    flows = [truth.flow(a, b, 80).flow_px / (b - a) for a, b in itertools.pairwise(marks_s[1:])]
    return {"psnr": psnr, "log_images": np.array(images, np.float32), "px_s_80": np.array(flows)}


def detail_speed(log_image: NDArray[np.float32], px_s: NDArray[np.float32]) -> float:
    """Return how fast what half the width cannot show crosses its own edges, over the median speed.

    It is a median over pixels, weighted by the square of what 160 px lack of the image.
    """
    width = WIDTHS[-1]
    image = np.exp(np.minimum(log_image - log_white_level(log_image), 0.0))
    half = cv2.resize(image, (width // 2, width // 2), interpolation=cv2.INTER_AREA)
    lost = (image - cv2.resize(half, (width, width), interpolation=cv2.INTER_CUBIC)).ravel() ** 2
    down, right = np.gradient(cv2.GaussianBlur(image, (0, 0), 0.7))
    flow = cv2.resize(px_s, (width, width), interpolation=cv2.INTER_LINEAR)
    across = np.abs(flow[..., 0] * right + flow[..., 1] * down) / (np.hypot(right, down) + 1e-9)
    order = np.argsort(across.ravel())
    half_way = np.searchsorted(np.cumsum(lost[order]), 0.5 * lost.sum())
    return float(across.ravel()[order[half_way]] / np.median(np.linalg.norm(flow, axis=-1)))


def measure() -> None:
    """Measure what is not measured yet, and write the table."""
    digest, frozen = frozen_digest(), tomllib.loads(FROZEN.read_text())
    columns = [f"psnr_{C}_{width}" for C in THRESHOLDS for width in WIDTHS]
    lines = [f"# sha256 of lag.toml: {digest}\n"]
    lines.append(
        ",".join(["scene", "path", "window", "detail", "poles", "cutoff_hz", *columns]) + "\n"
    )
    for name, place in PLACES.items():
        world = None
        for number, path in enumerate(frozen[name]["path"]):
            done = cache_dir() / "lag_predictions" / digest / f"{name}_{number}.npz"
            if not done.exists():
                world = world or World(place)
                done.parent.mkdir(exist_ok=True)
                found = measure_path(world, path, seed=number)
                np.savez_compressed(done.with_suffix(".part.npz"), **found)
                done.with_suffix(".part.npz").rename(done)
                print(name, number, flush=True)
            found = np.load(done)
            psnr = found["psnr"].reshape(WINDOWS, 2, len(LAGS_PX), -1)
            detail = [*map(detail_speed, found["log_images"][:-1], found["px_s_80"])]
            for window, p, k in np.ndindex(psnr.shape[:3]):
                poles = (2, 1)[p]
                cutoff = path[f"cutoffs_hz_{poles}"][k]
                values = ",".join(f"{one:.3f}" for one in psnr[window, p, k])
                where = f"{name},{number},{window},{detail[window]:.2f}"
                lines.append(f"{where},{poles},{cutoff:g},{values}\n")
    write_text(MEASURED, "".join(lines))


@dataclass(frozen=True)
class Seen:
    """A measured window of one sensor at all widths, and what was predicted of it."""

    window: Window
    poles: int
    threshold: float
    predicted: tuple[str, ...]  # by width above the coarsest
    detail: float  # see `detail_speed`

    def right(self) -> Iterator[tuple[str, bool]]:
        """Yield each prediction with whether it came true; of a tie, whether the rule's did."""
        margins = np.diff(self.window.psnr_db)
        for sign, margin, width in zip(self.predicted, margins, WIDTHS[1:], strict=True):
            outcome = {
                FINER: margin > 0,
                COARSER: margin < 0,
                WITHIN: margin > -NEARLY_DB,
                TIE: self.finer_wins(width) == (margin > 0),
            }
            yield sign, bool(outcome[sign])

    def finer_wins(self, width: int) -> bool:
        v_px_s = self.window.speed_px_s * width / WIDTHS[-1]
        lag = lag_px(v_px_s, self.window.cutoff_hz, self.poles)
        return finer_wins(lag, CROSSING_PX if self.poles == 2 else ONE_POLE_PX)

    def by_law(self) -> int:
        """Return the index of the width that the rule takes."""
        return [*map(self.finer_wins, WIDTHS[1:]), False].index(False)

    def regret_db(self, index: int) -> float:
        """Return how much worse than the best a width is."""
        return max(self.window.psnr_db) - self.window.psnr_db[index]


def seen() -> list[Seen]:
    """Return what was measured, with its predictions."""
    frozen = tomllib.loads(FROZEN.read_text())
    with MEASURED.open() as file:
        if frozen_digest() not in next(file):
            sys.exit(f"error: {MEASURED}: not measured after {FROZEN.name}; measure again")
        rows = [*csv.DictReader(file)]
    found = []
    for row in rows:
        poles, k = int(row["poles"]), int(row["window"])
        path = frozen[row["scene"]]["path"][int(row["path"])]
        cutoff = float(row["cutoff_hz"])
        number = [f"{f:g}" for f in path[f"cutoffs_hz_{poles}"]].index(row["cutoff_hz"])
        predicted = tuple(path[f"window_{k}_poles_{poles}_{w}"][number] for w in WIDTHS[1:])
        for C in THRESHOLDS:
            psnr = tuple(float(row[f"psnr_{C}_{width}"]) for width in WIDTHS)
            where = "unseen", row["scene"], WINDOWS * int(row["path"]) + k, cutoff, 1.0
            window = Window(*where, path["v_px_s"][k], WIDTHS, psnr, ())
            found.append(Seen(window, poles, C, predicted, float(row["detail"])))
    return found


def print_shares(cases: list[Seen], poles: int) -> None:
    """Print how often predictions came true, and what following them costs, by scene."""
    crossing = CROSSING_PX if poles == 2 else ONE_POLE_PX
    heads = f"outside {crossing * LOW:.1f} to {crossing * HIGH:.1f} px", "right there"
    lines = []
    for name in [*PLACES, "all"]:
        own = [e for e in cases if e.poles == poles and name in ("all", e.window.scene)]
        right = [(each.threshold, *one) for each in own for one in each.right()]
        far = [(C, ok) for C, sign, ok in right if sign != TIE]
        by_C = [share(ok for C, ok in far if one == C) for one in THRESHOLDS]
        regret = np.median([each.regret_db(each.by_law()) for each in own])
        detail = np.median([each.detail for each in own])
        cells = len(far), share(ok for _, ok in far), *by_C, share(ok for _, _, ok in right)
        lines.append((name.replace("_", " "), *cells, f"{regret:.2f}", f"{detail:.2f}"))
    columns = *(f"C = {C}" for C in THRESHOLDS), "at any lag", "median regret, dB", "detail"
    table((f"{poles} pole{'s' * (poles > 1)}", *heads, *columns), lines)


def print_regrets(cases: list[Seen]) -> None:
    """Print what following the law costs, next to always taking one width."""
    rules: dict[str, Callable[[Seen], int]] = {
        "the law": Seen.by_law,
        "always 320 px": lambda _: 2,
        "always 160 px": lambda _: 1,
    }
    lines = []
    for poles, (rule, index) in itertools.product((2, 1), rules.items()):
        cells = []
        for C in THRESHOLDS:
            own = [each for each in cases if (each.poles, each.threshold) == (poles, C)]
            regrets = [each.regret_db(index(each)) for each in own]
            numbers = np.mean(regrets), np.median(regrets), max(regrets)
            cells.append(", ".join(f"{one:.2f}" for one in numbers))
        lines.append((poles, rule, *cells))
    table(("poles", "rule", *(f"C = {C}" for C in THRESHOLDS)), lines)


def image() -> None:
    """Print what following the spectrum of a window's first image costs, of measured paths."""
    frozen = tomllib.loads(FROZEN.read_text(encoding="utf-8"))
    folder = cache_dir() / "lag_predictions" / frozen_digest()

    @cache
    def moving(name: str, sample: int) -> MovingImage:
        number, window = divmod(sample, WINDOWS)
        found, path = np.load(folder / f"{name}_{number}.npz"), frozen[name]["path"][number]
        light = np.exp(found["log_images"][window].astype(float))
        flow = found["px_s_80"][window].reshape(-1, 2)
        x, y = np.median(flow, axis=0)
        coherent = np.hypot(*flow.mean(axis=0)) > COHERENT * np.hypot(*flow.T).mean()
        start_s, end_s = path["marks_s"][window + 1 : window + 3]
        path_px = path["v_px_s"][window] * (end_s - start_s)
        degrees = math.degrees(math.atan2(y, x)) if coherent else None
        return MovingImage(np.minimum(light / white_level(light), 1.0), path_px, degrees)

    lines = []
    for poles in (2, 1):
        cells = []
        for C in THRESHOLDS:
            regrets = []
            for each in seen():
                if (each.poles, each.threshold) == (poles, C):
                    at = each.window
                    lag = lag_px(at.speed_px_s, at.cutoff_hz, poles)
                    of = moving(at.scene, at.sample)
                    psnr = [of.psnr_db(width, [lag], C, poles)[0] for width in WIDTHS]
                    regrets.append(each.regret_db(int(np.argmax(psnr))))
            numbers = np.mean(regrets), np.median(regrets), max(regrets)
            cells.append(", ".join(f"{one:.2f}" for one in numbers))
        lines.append((poles, "the image", *cells))
    table(("poles", "rule", *(f"C = {C}" for C in THRESHOLDS)), lines)


def main() -> None:
    commands: dict[tuple[str, ...], Callable[[], None]] = {
        ("fetch",): fetch,
        ("predict",): predict,
        ("measure",): measure,
        ("image",): image,
        (): lambda: None,
    }
    given = tuple(sys.argv[1:])
    if given not in commands:
        sys.exit(
            f"error: found {' '.join(given)}, expected fetch, predict, measure, image or nothing"
        )
    commands[given]()
    if given in ((), ("measure",)):
        cases = seen()
        print_shares(cases, 2)
        print_shares(cases, 1)
        print_regrets(cases)


if __name__ == "__main__":
    main()
