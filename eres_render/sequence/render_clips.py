"""Render clips of a scene into folders; frames that exist are kept."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eres_render.camera import Camera
from eres_render.errors import RenderError
from eres_render.progress import Progress, silent
from eres_render.rendering.backend import release_memory
from eres_render.rendering.renderer import Integrator, Renderer
from eres_render.scene.scene import Scene
from eres_render.sequence.clips import Clip, clips, continuous_stretch
from eres_render.sequence.manifest import FORMAT_VERSION, Manifest
from eres_render.sequence.monte_carlo_noise import warn_of_noise
from eres_render.sequence.sequence import RadianceSequence, SequenceWriter
from eres_render.storage.locks import locked
from eres_render.trajectory.frame_times import adaptive_times, warn_if_far_apart


def render_clip(
    renderer: Renderer,
    clip: Clip,
    out_dir: Path,
    max_displacement_px: float,
    on_progress: Progress = silent,
) -> RadianceSequence:
    """Render one clip into a folder, or finish it where a killed render stopped.

    Frames are so close in time that no point of the image moves farther than `max_displacement_px`
    from one to the next. Each frame is written while the next one renders. While another process
    renders into the folder, this one waits and then finds the frames there.

    Parameters
    ----------
    renderer
        Renders the frames.
    clip
        What to render.
    out_dir
        The sequence's own folder. If it holds an unfinished sequence with exactly these settings,
        only the missing frames are rendered.
    max_displacement_px
        In pixels of the render.
    on_progress
        Called after each frame; frames that exist count as done.

    Returns
    -------
    sequence
        The complete sequence.

    Raises
    ------
    RenderError
        If the folder holds a sequence with other settings, or cannot be written; finished frames
        stay.
    """
    scene, camera = renderer.scene, renderer.camera
    t_s = adaptive_times(renderer.image_motion, clip.marks_s, max_displacement_px)
    poses = renderer.trajectory.pose(t_s)
    centered = camera == Camera(camera.width, camera.height, camera.fov_rad)
    manifest = Manifest(
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
        max_displacement_px=max_displacement_px,
        integrator=renderer.integrator,
        variant=renderer.variant,
        mitsuba=version("mitsuba"),
        t_offset_us=renderer.trajectory.t_offset_us,
        intrinsics=None if centered else (camera.fx, camera.fy, camera.cx, camera.cy),
    )
    with locked(out_dir / ".lock"):
        writer = SequenceWriter(out_dir, manifest, renderer.trajectory)
        _render_missing(renderer, poses, writer, on_progress)
        release_memory()
        return writer.finish()


def _render_missing(
    renderer: Renderer,
    poses: NDArray[np.float64],  # (T, 4, 4) T_world_cam of all frames
    writer: SequenceWriter,
    on_progress: Progress,
) -> None:
    missing = writer.missing()
    done = len(poses) - len(missing)
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="exr") as pool:
        writing: Future[None] | None = None
        for i in missing:
            radiance = renderer.frame(poses[i])
            if writing is not None:
                writing.result()
            writing = pool.submit(writer.write, i, radiance)
            done += 1
            on_progress("rendering", done, len(poses))
        if writing is not None:
            writing.result()


def render_scene(
    scene: Scene,
    out_dir: Path,
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
    on_progress: Progress = silent,
) -> list[RadianceSequence]:
    """Render a scene's clips into `out_dir/clip_000`, ..., or all of its path into one sequence.

    Frames that exist are kept. A warning says how noisy path-traced frames are and how many false
    events that makes; another one, if frames are far apart.

    Parameters
    ----------
    scene
        What to render.
    out_dir
        Folder of the sequences.
    resolution
        Side of the square image in pixels, where no camera is given.
    spp, seed, integrator, camera
        As for `Renderer`.
    duration_s, samples
        How much of the path, and the number of clips; see `clips`.
    max_displacement_px
        As for `render_clip`.
    continuous
        Render everything from the path's start to `duration_s` into `out_dir/continuous`, instead
        of clips. Memory does not grow with the number of frames.
    on_progress
        Called while light is baked, and as the frames of each sequence are done.

    Returns
    -------
    sequences
        One for each clip.

    Raises
    ------
    RenderError
        As `Renderer`, `clips` and `render_clip`.
    """
    scene.trajectory(camera)  # a bad path is refused before anything is loaded or baked
    if continuous:
        if samples is not None:
            raise RenderError(f"samples: found {samples}, but a continuous sequence has no clips")
        wanted = {"continuous": continuous_stretch(scene, duration_s)}
    else:
        wanted = {f"clip_{c.index:03d}": c for c in clips(scene, duration_s, samples=samples)}
    warn_if_far_apart(scene.name, max_displacement_px)
    renderer = Renderer(scene, resolution, spp, seed, integrator, on_progress, camera=camera)
    warn_of_noise(renderer, list(wanted.values()), max_displacement_px)
    sequences = []
    for k, (name, clip) in enumerate(wanted.items(), start=1):

        def on_frame(stage: str, done: float, total: float, /, k: int = k) -> None:
            on_progress(f"{stage} {scene.name}, sequence {k} of {len(wanted)}", done, total)

        folder = Path(out_dir) / name
        sequences.append(render_clip(renderer, clip, folder, max_displacement_px, on_frame))
    return sequences
