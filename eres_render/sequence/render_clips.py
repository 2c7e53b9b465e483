"""Render clips of a scene into folders; frames that exist are kept."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eres_render.camera import Camera
from eres_render.errors import RenderError
from eres_render.progress import Progress, silent
from eres_render.rendering.backend import release_render_memory, select_variant
from eres_render.rendering.lightmaps import has_lightmaps
from eres_render.rendering.renderer import Integrator, Renderer, best_integrator
from eres_render.scene.scene import Scene
from eres_render.sequence.clips import Clip, clips, continuous_stretch
from eres_render.sequence.estimate import estimate
from eres_render.sequence.manifest import FORMAT_VERSION, RENDER_VERSION, Manifest, plane_values
from eres_render.sequence.monte_carlo_noise import warn_of_noise
from eres_render.sequence.sequence import (
    RadianceSequence,
    SequenceWriter,
    is_complete,
    open_sequence,
    read_ahead,
    read_path,
)
from eres_render.storage.exr import Compression, to_half
from eres_render.storage.locks import locked
from eres_render.trajectory.frame_times import (
    FrameTimes,
    adaptive_times,
    earlier_times,
    warn_if_far_apart,
)

_log = logging.getLogger(__name__)

_TOLD_S = 10.0  # what takes longer is told before


@dataclass(frozen=True, eq=False, slots=True, repr=False, kw_only=True)
class _ClipInProgress(RadianceSequence):
    """A sequence that renders and writes each missing frame when it is first read.

    A frame is rounded to half precision first, so it is the same whether rendered or read.
    """

    renderer: Renderer
    poses: NDArray[np.float64]  # (T, 4, 4) to render, before they were rounded as text
    writer: SequenceWriter
    writing: Executor
    unread: set[int]  # frames that have not been read yet
    on_progress: Progress
    one_at_a_time: threading.Lock = field(default_factory=threading.Lock)
    last_write: list[Future[None]] = field(default_factory=list)  # one at most

    def __iter__(self) -> Iterator[NDArray[np.float32]]:
        self.wait()
        for i, stored in enumerate(read_ahead(self.writer.read, range(len(self)))):
            with self.one_at_a_time:
                frame = self._whole(i, stored)
            yield frame

    def frame(self, i: int) -> NDArray[np.float32]:
        """Return frame i as `RadianceSequence.frame` does; render it if it is missing."""
        self._check_number(i)
        with self.one_at_a_time:
            self.wait()
            return self._whole(i, self.writer.read(i))

    def wait(self) -> None:
        """Return when all rendered frames are on disk; raise if one could not be written."""
        for write in self.last_write:
            write.result()

    def _whole(self, i: int, stored: NDArray[np.float32] | None) -> NDArray[np.float32]:
        self.unread.discard(i)
        if stored is not None:
            return stored
        started_s = time.perf_counter()
        radiance = self.renderer.frame(self.poses[i], t_s=self.manifest.t_s[i])
        half = to_half(radiance, self.writer.file(i))
        if radiance.min() < 0 and half.min() < 0:  # readers refuse it; half-floats compare slowly
            row, column = np.argwhere(half < 0)[0]
            raise RenderError(
                f"{self.writer.file(i)}: pixel x={column} y={row}: found {half[row, column]:g}, "
                "expected a radiance of 0 or more; is a texture or a light of the scene negative?"
            )
        self.rendered.frames += 1
        self.rendered.seconds += time.perf_counter() - started_s
        self.wait()
        self.last_write[:] = [self.writing.submit(self.writer.write, i, half)]
        self.on_progress("rendering", i + 1, len(self))
        return half.astype(np.float32)


@contextmanager
def clip_in_progress(
    renderer: Renderer,
    clip: Clip,
    out_dir: str | Path,
    max_displacement_px: float,
    compression: Compression = "none",
    on_progress: Progress = silent,
    frame_times: FrameTimes = adaptive_times,
) -> Iterator[RadianceSequence]:
    """Open a clip as a sequence whose missing frames are rendered when they are first read.

    Frames are so close in time that no point of the image moves farther than `max_displacement_px`
    between two of them. They are also written into a folder, and read back the same to the bit.
    While another process renders into the folder, this process waits.

    Parameters
    ----------
    renderer
        Renders the frames, from one thread at a time.
    clip
        What to render.
    out_dir
        The sequence's own folder. If it holds an unfinished sequence with exactly these settings,
        only the missing frames are rendered.
    max_displacement_px
        Largest motion from frame to frame, in pixels of the render.
    compression
        Compression of the files; the default, none, costs the least time.
    on_progress
        Called after each rendered frame, with the number of frames up to this one.
    frame_times
        `adaptive_times`; or `paced_times`, which costs less if cameras and objects move fast and
        evenly.

    Yields
    ------
    The sequence. It is complete on disk after the context if all its frames were read.

    Raises
    ------
    RenderError
        If the clip ends after the path, or the folder holds a sequence with other settings or
        cannot be written. Finished frames stay.

    Examples
    --------
    A sensor sees frames as they are rendered; the folder has them afterwards:

    >>> from eres_render import Clip, Renderer, clip_in_progress, load_scene, open_sequence
    >>> from sensor import SensorModel, simulate
    >>> renderer = Renderer(load_scene("carpet"), width=64, spp=4)
    >>> with clip_in_progress(renderer, Clip(0, 0.2, 0.25, 0.3), "clip", 0.5) as frames:
    ...     events = simulate(frames, frames.t_s, SensorModel(width=64, height=64))
    >>> len(events) > 0, len(open_sequence("clip")) == len(frames)
    (True, True)
    """
    out_dir = Path(out_dir)
    if clip.t_window_end_s > renderer.scene.duration_s:
        raise RenderError(
            f"Clip {clip.index}: ends at {clip.t_window_end_s:g} s, but "
            f"{renderer.scene.path_name} ends at {renderer.scene.duration_s:g} s"
        )
    t_s = frame_times(renderer.image_motion, clip.marks_s, max_displacement_px)
    if clip.t_anchor_s is not None:
        times_s = clip.t_anchor_s, clip.t_start_s
        before_s = earlier_times(renderer.image_motion, *times_s, max_displacement_px)
        t_s = np.concatenate([before_s, t_s])
    manifest = _manifest(renderer, clip, t_s, max_displacement_px)
    with locked(out_dir / ".lock"), ThreadPoolExecutor(1, thread_name_prefix="exr") as writing:
        writer = SequenceWriter(out_dir, manifest, renderer.trajectory, compression)
        # As read back, where rotations are quaternions: ground truth is the same to the bit, too.
        T_world_cam, trajectory = read_path(out_dir, manifest)
        sequence = _ClipInProgress(
            folder=out_dir,
            manifest=manifest,
            T_world_cam=T_world_cam,
            trajectory=trajectory,
            checksums=writer.checksums,
            renderer=renderer,
            poses=renderer.trajectory.pose(t_s),
            writer=writer,
            writing=writing,
            unread=set(range(len(t_s))),
            on_progress=on_progress,
        )
        yield sequence
        sequence.wait()
        release_render_memory()
        if not sequence.unread:
            writer.finish()


def _manifest(
    renderer: Renderer, clip: Clip, t_s: NDArray[np.float64], max_displacement_px: float
) -> Manifest:
    scene, camera = renderer.scene, renderer.camera
    centered = camera == Camera(camera.width, camera.height, camera.fov_rad)
    return Manifest(
        version=FORMAT_VERSION,
        complete=False,
        scene=scene.name,
        scene_source=scene.source,
        scene_digest=scene.digest,
        light_digest=scene.light_digest,
        clip=clip.index,
        width=camera.width,
        height=camera.height,
        fov_rad=camera.fov_rad,
        t_s=tuple(t_s.tolist()),
        window_s=(clip.t_window_start_s, clip.t_window_end_s),
        white_level=renderer.white_level,
        spp=renderer.spp,
        seed=renderer.seed,
        max_displacement_px=float(max_displacement_px),
        integrator=renderer.integrator,
        variant=renderer.variant,
        mitsuba=version("mitsuba"),
        t_offset_us=renderer.trajectory.t_offset_us,
        intrinsics=None if centered else (camera.fx, camera.fy, camera.cx, camera.cy),
        distortion=camera.distortion,
        objects=tuple(scene.settings.objects or ()),
        plane=plane_values(scene),
        render_version=RENDER_VERSION,
    )


def render_clip(
    renderer: Renderer,
    clip: Clip,
    out_dir: str | Path,
    max_displacement_px: float,
    on_progress: Progress = silent,
    frame_times: FrameTimes = adaptive_times,
) -> RadianceSequence:
    """Render a clip into a folder, or finish what a killed render left.

    Parameters
    ----------
    renderer, clip, out_dir, max_displacement_px, on_progress, frame_times
        As for `clip_in_progress`.

    Returns
    -------
    sequence
        The complete sequence.

    Raises
    ------
    RenderError
        As `clip_in_progress`.

    Examples
    --------
    >>> from eres_render import Clip, Renderer, load_scene, render_clip
    >>> renderer = Renderer(load_scene("carpet"), width=64, spp=4)
    >>> sequence = render_clip(renderer, Clip(0, 0.24, 0.25, 0.26), "short", 0.5)
    >>> sequence.window_s, sequence.frame(0).shape
    ((0.25, 0.26), (64, 64))
    """
    where = out_dir, max_displacement_px
    with clip_in_progress(renderer, clip, *where, "zip", on_progress, frame_times) as sequence:
        for _ in sequence:
            pass
    return open_sequence(out_dir)


def render_scene(
    scene: Scene,
    out_dir: str | Path,
    *,
    resolution: int = 1280,
    spp: int = 16,
    seed: int = 0,
    integrator: Integrator | None = None,
    duration_s: float | None = None,
    max_displacement_px: float = 0.5,
    samples: int | None = None,
    continuous: bool = False,
    camera: Camera | None = None,
    warm_up_s: float | None = None,
    dry_run: bool = False,
    on_progress: Progress = silent,
) -> list[RadianceSequence]:
    """Render a scene's clips into `out_dir/clip_000`, ..., or all of its path into one sequence.

    Existing frames are not rendered again. The log gives the number of frames, their disk space and
    time before what takes long. Warnings give the noise of path-traced frames and the number of
    false events that it causes, and say if frames are far apart.

    Parameters
    ----------
    scene
        What to render.
    out_dir
        Folder of the sequences.
    resolution
        Side of the square image in pixels, if no camera is given.
    spp, seed, integrator, camera
        As for `Renderer`.
    duration_s, samples
        How much of the path, and the number of clips; see `clips`.
    max_displacement_px
        As for `render_clip`.
    continuous
        Instead of clips, render the path up to `duration_s` into `out_dir/continuous`. Memory does
        not grow with the number of frames.
    warm_up_s
        Length of each clip before its window, s; by default as in `clips`.
    dry_run
        Whether only to log what it would take; light is not baked.
    on_progress
        Called while light is baked, and for each rendered frame.

    Returns
    -------
    sequences
        One for each clip; none after a dry run.

    Raises
    ------
    RenderError
        As `Renderer`, `clips` and `render_clip`.

    Examples
    --------
    >>> from eres_render import load_scene, render_scene
    >>> carpet = load_scene("carpet")
    >>> sequences = render_scene(carpet, "clips", resolution=64, spp=1, samples=1)
    >>> [sequence.folder.name for sequence in sequences]
    ['clip_000']
    """
    camera = camera or scene.camera(resolution)
    scene.trajectory(camera)  # a bad path is refused before anything is loaded or baked
    if continuous:
        for name, value in (("samples", samples), ("warm_up", warm_up_s)):
            if value is not None:
                raise RenderError(f"{name}: found {value}, but a continuous sequence has no clips")
        wanted = {"continuous": continuous_stretch(scene, duration_s)}
    else:
        before = {} if warm_up_s is None else {"warm_up_s": warm_up_s}
        fitting = clips(scene, duration_s, samples=samples, **before)
        wanted = {f"clip_{c.index:03d}": c for c in fitting}
    folders = {Path(out_dir) / name: clip for name, clip in wanted.items()}
    known: dict[str, object] = {
        "width": camera.width,
        "height": camera.height,
        "fov_rad": camera.fov_rad,
    }
    known |= {"spp": spp, "seed": seed, "max_displacement_px": max_displacement_px}
    known["scene_digest"] = scene.digest
    missing = [clip for folder, clip in folders.items() if not is_complete(folder, known)]
    warn_if_far_apart(scene.name, max_displacement_px)
    unbaked = False
    if dry_run:
        integrator = integrator or best_integrator(scene, select_variant())
        unbaked = integrator in ("baked", "baked-full") and not has_lightmaps(scene)
    how: Integrator | None = "emission" if unbaked else integrator
    renderer = Renderer(scene, resolution, spp, seed, how, on_progress, camera=camera)
    if missing:
        takes_s, text = estimate(renderer, missing, max_displacement_px)
        if dry_run or takes_s > _TOLD_S:
            _log.info("%s%s", text, ", after light is baked" if unbaked else "")
    if dry_run:
        return []
    warn_of_noise(renderer, list(wanted.values()), max_displacement_px)
    sequences = []
    for k, (folder, clip) in enumerate(folders.items(), start=1):

        def on_frame(stage: str, done: float, total: float, /, k: int = k) -> None:
            on_progress(f"{stage} {scene.name}, sequence {k} of {len(wanted)}", done, total)

        sequences.append(render_clip(renderer, clip, folder, max_displacement_px, on_frame))
    return sequences
