"""Render frames of a scene through a moving camera."""

from __future__ import annotations

import copy
import functools
import logging
import math
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from eres_render.camera import Camera, Plane
from eres_render.errors import RenderError, SceneError, check_spp, suggestion
from eres_render.progress import Progress, silent
from eres_render.rendering.backend import select_variant
from eres_render.rendering.clearance import check_clearance
from eres_render.rendering.irradiance import reason_not_to_wait, refuse_objects
from eres_render.rendering.lambertian import reason_not_to_bake, surfaces
from eres_render.rendering.lens import undistorted
from eres_render.rendering.lightmaps import baked_scene, has_lightmaps
from eres_render.rendering.load import load_mi_scene
from eres_render.rendering.lookup import NEAR_M, LookUp
from eres_render.rendering.memory import check_render_memory
from eres_render.rendering.motion import Body, PlacedObjects, still_and_bodies
from eres_render.rendering.raycast import RayCaster
from eres_render.scene.objects import MovingObject
from eres_render.scene.scene import Scene
from eres_render.storage.exr import MIN_WHITE
from eres_render.trajectory import frame_times
from eres_render.trajectory.frame_times import ImageMotion
from eres_render.trajectory.spline import Trajectory

Float64 = NDArray[np.float64]
Integrator = Literal["baked", "baked-full", "path", "emission"]

_log = logging.getLogger(__name__)

_VIEWS = 9  # rays along a side of the image that show whether the camera sees the plane
_MAX_ROUNDING_PX = 0.05  # a tenth of the usual motion from frame to frame
_DEPTHS = 33  # rays along a side of the image that find the nearest surface
_MOTIONS = 1 << 16  # between two times, that are kept: about 15 for a frame
_OFF_PLANE = 0.01  # relief stays below this share of the distance
_WHITE_SPP = 4  # with more, the 99.9th percentile changes by less than matters

# Mitsuba's camera looks along z with x to the left and y up; ours has x right and y down.
_CAM_FROM_MITSUBA = np.diag([-1.0, -1.0, 1.0, 1.0])


class Renderer:
    """Renders linear radiance of one scene from any pose.

    Every frame uses the same random numbers. So radiance is a continuous function of the pose, and
    the remaining Monte Carlo error moves with the camera instead of flickering. If objects move,
    each frame has a time and is path-traced by default, because shadows and reflected light move
    too.

    Parameters
    ----------
    scene
        Scene to render.
    width
        Side of the square image in pixels, if no camera is given.
    spp
        Samples per pixel, stratified over the pixel's area (a box filter; other filters would blur
        the image). A square is best: 1, 4, 9, 16, ... Otherwise the multijittered sampler needs a
        multiple of the square root of `spp`, rounded down.
    seed
        Seed of the sampler, 0 to 2^32 - 1.
    integrator
        - "baked": light is computed once, for Lambertian surfaces;
        - "baked-full": the same light, but a ray for every sample, while "baked" looks most samples
          up (`eres_render.rendering.lookup`);
        - "path": path tracing in every frame, which is noisy (`measure_noise`);
        - "emission": only the light that surfaces emit, without shadows, reflections and noise;
          looked up like "baked", unless objects move.

        By default "path" if objects move, else "emission" if nothing reflects light, "baked" if
        possible within about an hour, or "path". Scenes with moving objects need "path" or
        "emission".
    on_progress
        Called while light is baked, if that is necessary.
    camera
        Replaces the scene's square camera: any image size, focal lengths, principal point and lens.
        The lens bends each sample of a pixel.

    Raises
    ------
    RenderError
        If the sampler cannot lay out `spp` samples, the seed or the size of the image is out of
        range, the image needs more memory than this machine has, or the Mitsuba variant is scalar
        and the camera has a lens or pixels that are not square.
    BackendError
        If no Mitsuba variant works here, or lightmaps are missing and cannot be baked here.
    SceneError
        If Mitsuba refuses the scene, light cannot be baked, or an object cannot move.
    TrajectoryError
        If the path of an object cannot be read or is too short, or the scene must be baked and the
        camera's path comes too near a surface.

    Examples
    --------
    >>> from eres_render import Renderer, load_scene
    >>> scene = load_scene("carpet")
    >>> renderer = Renderer(scene, width=64, spp=4)
    >>> renderer.frame(scene.trajectory().pose(1.0)).shape
    (64, 64)
    """

    def __init__(
        self,
        scene: Scene,
        width: int = 1280,
        spp: int = 16,
        seed: int = 0,
        integrator: Integrator | None = None,
        on_progress: Progress = silent,
        *,
        camera: Camera | None = None,
    ) -> None:
        _check_seed(seed)
        if integrator not in (None, *get_args(Integrator)):
            hint = suggestion(str(integrator), get_args(Integrator))
            raise RenderError(f"integrator: found {integrator!r}; {hint}")
        self.scene = scene
        self.seed = int(seed)
        self.variant = select_variant()
        camera = camera or scene.camera(width)
        # Before all slow work; a baked scene needs more memory, which is checked below.
        check_render_memory(camera, spp, integrator or "path", self.variant)
        self._use_camera(camera, spp)

        import mitsuba as mi

        self.integrator: Integrator = integrator or best_integrator(scene, self.variant)
        check_render_memory(camera, spp, self.integrator, self.variant)
        baked = self.integrator in ("baked", "baked-full")
        if baked:
            refuse_objects(scene)
        if baked and scene.has_path and not has_lightmaps(scene):
            # Baking takes minutes, so the path is checked first.
            _check_path(scene, camera, RayCaster(load_mi_scene(scene)), ())
        self._mi_scene: Any
        self._look_up: LookUp | None = None
        if baked:
            self._mi_scene, shape_ids = baked_scene(scene, on_progress)
        else:
            self._mi_scene, shape_ids = load_mi_scene(scene), set()
        glows = self.integrator in ("baked", "emission") and not scene.settings.objects
        flat = any(shape.is_mesh() for shape in self._mi_scene.shapes())
        if glows and flat and self.variant.startswith("llvm"):
            self._look_up = LookUp(self._mi_scene, shape_ids)
        self._objects: tuple[MovingObject, ...] = ()
        self._placed: PlacedObjects | None = None
        if scene.settings.objects:
            offset_us = scene.trajectory(camera).t_offset_us
            self._objects = scene.objects(offset_us, scene.duration_s)
            self._placed = PlacedObjects(self._mi_scene, self._objects, scene.xml_file)
        # Without reflected light every path ends at the first surface it meets.
        depth = -1 if self.integrator == "path" else 1
        self._tracer: Any = mi.load_dict({"type": "path", "max_depth": depth})

    def at(self, *, spp: int) -> Renderer:
        """Return a renderer of the same loaded scene with a different number of samples per pixel.

        Raises
        ------
        RenderError
            If the sampler cannot lay out `spp` samples, or they need too much memory.
        """
        check_render_memory(self.camera, spp, self.integrator, self.variant)
        other = copy.copy(self)
        other.white_level = self.white_level
        other._use_camera(self.camera, spp)
        return other

    def _use_camera(self, camera: Camera, spp: int) -> None:
        import mitsuba as mi

        check_spp(spp, RenderError)
        is_plain = camera.fx == camera.fy and camera.distortion is None
        if not is_plain and self.variant.startswith("scalar"):
            raise RenderError(
                f"camera: {self.variant} renders only square pixels without distortion, but fx = "
                f"{camera.fx}, fy = {camera.fy}, distortion = {camera.distortion}; "
                "install LLVM (apt-get install libllvm19)"
            )
        self.camera, self.spp = camera, int(spp)
        self._kept_positions: tuple[tuple[int, int], Any] | None = None  # and their spp and seed
        self._sensor = mi.load_dict(_mitsuba_camera(camera, spp))
        self._camera_parameters = mi.traverse(self._sensor)

    def frame(
        self, T_world_cam: Float64, seed: int | None = None, *, t_s: float | None = None
    ) -> NDArray[np.float32]:
        """Render the radiance seen from a pose.

        Parameters
        ----------
        T_world_cam
            (4, 4) pose.
        seed
            Seed of the sampler, in place of the renderer's. Noise differs from seed to seed, and an
            event camera would see that as flicker.
        t_s
            Time on the camera's path, s; required if objects move.

        Returns
        -------
        radiance
            (H, W) float32, W m^-2 sr^-1.

        Raises
        ------
        RenderError
            If objects move and no time is given, or the seed is out of range.
        """
        seed = self.seed if seed is None else seed
        _check_seed(seed)
        return self._render(T_world_cam, t_s, self.spp, int(seed))

    def repeats(
        self,
        T_world_cam: Float64,
        pixels: NDArray[np.integer],
        count: int,
        *,
        t_s: float | None = None,
    ) -> NDArray[np.float32]:
        """Render a few pixels several times.

        Each render has its own random numbers. They stay the same from pose to pose, as in frames.

        Parameters
        ----------
        T_world_cam
            (4, 4) pose.
        pixels
            (N,) `row * width + column`.
        count
            Number of renders of each pixel.
        t_s
            As for `frame`.

        Returns
        -------
        radiance
            (count, N) float32, W m^-2 sr^-1.

        Raises
        ------
        RenderError
            If objects move and no time is given.
        """
        self._place_objects(t_s)
        if self.variant.startswith("scalar"):
            return self._repeats_scalar(T_world_cam, pixels, count)
        self._look_from(T_world_cam)
        flat = self._render_vectorized(self.spp, self.seed, np.tile(pixels, count))
        return flat.reshape(count, len(pixels))

    @cached_property
    def white_level(self) -> float:
        """The scene's white: 99.9th percentile of the radiance along its whole path.

        It is measured in five whole frames, evenly spaced in time, at 4 samples per pixel. It does
        not depend on `spp`, on the clips that are rendered or on the number of threads.

        Raises
        ------
        SceneError
            If nearly everything in view is black.
        """
        t_s = np.linspace(0.0, self.scene.duration_s, 5)
        frames = [
            self._render(T, t, _WHITE_SPP, self.seed)
            for t, T in zip(t_s.tolist(), self.trajectory.pose(t_s), strict=True)
        ]
        white = float(np.percentile(np.stack(frames), 99.9))
        if not white > 0:
            raise SceneError(
                f"{self.scene.xml_file}: found no light (white, the 99.9th percentile of radiance "
                f"along the path, is {white:g}); light the camera's view with an <emitter>, and "
                "look for NaN in textures"
            )
        if white < MIN_WHITE:
            _log.warning(
                "%s: white, the 99.9th percentile of radiance along the path, is %.3g. Below %g, "
                "frames in half-floats round shadows visibly, which causes false events: scale all "
                "emitters up",
                self.scene.xml_file,
                white,
                MIN_WHITE,
            )
        return white

    @cached_property
    def trajectory(self) -> Trajectory:
        """The scene's camera path, checked to keep clear of all surfaces and moving objects.

        Raises
        ------
        TrajectoryError, SceneError
            If there is no path, or it comes too near a surface. The message names the time and the
            obstacle.
        """
        return _check_path(self.scene, self.camera, *self._still_and_bodies)

    @cached_property
    def image_motion(self) -> ImageMotion:
        """Largest motion of the image between two times on the path, px.

        In path-traced light, shadows and reflected light of objects out of view count too.
        """
        trajectory, camera = self.trajectory, self.camera
        path = frame_times.RecentPoses(trajectory)
        if self.scene.plane is not None:
            of_still = frame_times.plane_image_motion(trajectory, camera, self.scene.plane)
        else:
            of_still = frame_times.depth_image_motion(path, camera, self.inverse_depth)
        px_per_m = functools.lru_cache(maxsize=1)(self._px_per_m)

        def of_body(body: Body) -> ImageMotion:
            shadow = frame_times.shadow_image_motion(body.pose, body.box_m, px_per_m)
            unseen = shadow if self.integrator == "path" else None
            at = body.pose, body.box_m
            return frame_times.object_image_motion(path, camera, *at, body.caster.distance, unseen)

        motions = of_still, *map(of_body, self._still_and_bodies[1])
        # An estimate of the cost and the render itself ask for the same.
        return functools.lru_cache(_MOTIONS)(
            lambda t_0_s, t_1_s: max(motion(t_0_s, t_1_s) for motion in motions)
        )

    def inverse_depth(self, T_world_cam: Float64, points_px: Float64) -> Float64:
        """Return the inverse of the z-depth at some pixels, of all that stands still.

        Parameters
        ----------
        T_world_cam
            (4, 4) pose.
        points_px
            (N, 2) pixels.

        Returns
        -------
        inverse_depth
            (N,) 1/m; 0 where nothing is seen.
        """
        rays = self.camera.rays(points_px) @ T_world_cam[:3, :3].T
        return 1 / self._still_and_bodies[0].distance(T_world_cam[:3, 3], rays)

    def _px_per_m(self, t_s: float) -> float:
        """Return the image of a meter on the nearest surface that stands still and is in view."""
        points_px = self.camera.grid(_DEPTHS)
        per_depth = self.inverse_depth(self.trajectory.pose(t_s), points_px)
        return max(self.camera.fx, self.camera.fy) * float(per_depth.max())

    @cached_property
    def _still_and_bodies(self) -> tuple[RayCaster, tuple[Body, ...]]:
        # With objects, load the scene again: in the first one they move for the frames.
        mi_scene = load_mi_scene(self.scene) if self._objects else self._mi_scene
        return still_and_bodies(self.scene, mi_scene, self._objects)

    def _render(
        self, T_world_cam: Float64, t_s: float | None, spp: int, seed: int
    ) -> NDArray[np.float32]:
        self._look_from(T_world_cam)
        self._place_objects(t_s)
        if self.variant.startswith("scalar"):
            image = self._tracer.render(self._mi_scene, self._sensor, seed, spp)
            return np.asarray(image, dtype=np.float32)[:, :, 0]
        if self._look_up is not None and self._look_up.pays(self.camera, spp):
            return self._looked_up(self._look_up, T_world_cam, spp, seed)
        height, width = self.camera.height, self.camera.width
        return self._render_vectorized(spp, seed).reshape(height, width)

    def _place_objects(self, t_s: float | None) -> None:
        if self._placed is None:
            return
        if t_s is None:
            raise RenderError(
                f"t_s: found None, expected a time, as objects of {self.scene.name} move"
            )
        self._placed.place(t_s)

    def _look_from(self, T_world_cam: Float64) -> None:
        self._camera_parameters["to_world"] = _to_world(T_world_cam)
        self._camera_parameters.update()

    def _render_vectorized(
        self, spp: int, seed: int, pixels: NDArray[np.integer] | None = None
    ) -> NDArray[np.float32]:
        """Render all pixels, or the (N,) listed pixels, which may repeat.

        Samples are summed in a fixed order. Mitsuba's vectorized films add them in an order that
        changes from run to run unless `spp` is a power of two, so the same pose would not give the
        same frame.
        """
        if self.integrator != "path":
            if pixels is None:
                return self._traced(self._positions(spp, seed), spp)
            return self._traced(self._sampled(spp, seed, pixels)[1], spp)
        sampler, position = self._sampled(spp, seed, pixels)
        ray, weight = self._rays(position)
        radiance, _, _ = self._tracer.sample(self._mi_scene, sampler, ray)
        return _means(weight * radiance, spp)

    def _traced(self, position: Any, spp: int) -> NDArray[np.float32]:
        """Trace what surfaces emit, or baked light, at positions in the image, `spp` a pixel."""
        import mitsuba as mi

        ray, weight = self._rays(position)
        # The same as `path` with max_depth 1, but without its loop, and with coherent rays for
        # Embree: together nearly twice as fast.
        si = self._mi_scene.ray_intersect(ray, mi.RayFlags.All, coherent=True, active=True)
        return _means(weight * si.emitter(self._mi_scene).eval(si), spp)

    def _looked_up(
        self, look_up: LookUp, T_world_cam: Float64, spp: int, seed: int
    ) -> NDArray[np.float32]:
        """Look up what surfaces emit, and trace it where that is not possible."""
        import drjit as dr
        import mitsuba as mi

        position = self._positions(spp, seed)

        def trace(pixels: NDArray[np.intp]) -> NDArray[np.float32]:
            sample = dr.arange(mi.UInt32, len(pixels) * spp)
            pixel = dr.gather(mi.UInt32, mi.UInt32(pixels.astype(np.uint32)), sample // spp)
            at = pixel * spp + sample % spp
            return self._traced(dr.gather(mi.Point2f, position, at), spp)

        def rays(column: Any, row: Any) -> Any:
            return self._rays(self._pinhole_in_film(mi.Point2f(column, row)))[0]

        x, y = np.asarray(position.x), np.asarray(position.y)
        threads = dr.thread_count()
        return look_up.frame(self.camera, T_world_cam, rays, x, y, trace, threads)

    def _positions(self, spp: int, seed: int) -> Any:
        """Return the samples' positions in the image, 0 to 1; kept for the next frame."""
        import drjit as dr

        if self._kept_positions is None or self._kept_positions[0] != (spp, seed):
            position = self._sampled(spp, seed, None)[1]
            dr.eval(position)  # or every frame would draw its random numbers again
            self._kept_positions = (spp, seed), position
        return self._kept_positions[1]

    def _sampled(self, spp: int, seed: int, pixels: NDArray[np.integer] | None) -> tuple[Any, Any]:
        """Return a new sampler, and the first positions in the image that it gave."""
        import drjit as dr
        import mitsuba as mi

        width, height = self.camera.width, self.camera.height
        n_samples = (width * height if pixels is None else len(pixels)) * spp
        sampler = self._sensor.sampler()
        sampler.set_sample_count(spp)
        sampler.set_samples_per_wavefront(spp)
        sampler.seed(seed, n_samples)

        # Opaque numbers are none of the code's, which is compiled once for all sizes.
        pixel = dr.arange(mi.UInt32, n_samples) // dr.opaque(mi.UInt32, spp)
        if pixels is not None:
            pixel = dr.gather(mi.UInt32, mi.UInt32(pixels.astype(np.uint32)), pixel)
        columns = dr.opaque(mi.UInt32, width)
        corner = mi.Point2f(mi.Float(pixel % columns), mi.Float(pixel // columns))
        return sampler, self._in_film(corner + sampler.next_2d())

    def _in_film(self, position: Any) -> Any:
        """Return where Mitsuba's square-pixel pinhole has the same rays, in shares of the image."""
        camera = self.camera
        if camera.distortion is not None:
            position = undistorted(camera, camera.distortion, position)
        return self._pinhole_in_film(position)

    def _pinhole_in_film(self, position: Any) -> Any:
        """Return what `_in_film` does, without the lens."""
        import drjit as dr
        import mitsuba as mi

        camera = self.camera
        if camera.fx != camera.fy:
            position.y = camera.cy + (position.y - camera.cy) * (camera.fx / camera.fy)
        share = (1 / np.array([camera.width, camera.height], np.float32)).tolist()
        return position * dr.opaque(mi.Point2f, share)

    def _rays(self, position: Any) -> tuple[Any, Any]:
        import mitsuba as mi

        return self._sensor.sample_ray(0.0, 0.0, position, mi.Point2f(0.5))

    def _repeats_scalar(
        self, T_world_cam: Float64, pixels: NDArray[np.integer], count: int
    ) -> NDArray[np.float32]:
        """Do `repeats` on films of one pixel, at the same cost per sample as a frame."""
        import mitsuba as mi

        radiance = np.empty((count, len(pixels)), np.float32)
        for k, pixel in enumerate(pixels.tolist()):
            row, column = divmod(pixel, self.camera.width)
            camera = _mitsuba_camera(self.camera, self.spp, (column, row))
            sensor = mi.load_dict(camera | {"to_world": _to_world(T_world_cam)})
            for r in range(count):
                seed = (self.seed + 1 + k * count + r) % (1 << 32)
                image = self._tracer.render(self._mi_scene, sensor, seed, self.spp)
                radiance[r, k] = np.asarray(image)[0, 0, 0]
        return radiance


def _check_seed(seed: int) -> None:
    if not 0 <= seed < 1 << 32:
        raise RenderError(f"seed: found {seed}, expected 0 to 2^32 - 1")


def _means(samples: Any, spp: int) -> NDArray[np.float32]:
    import drjit as dr

    return np.asarray(dr.block_sum(samples[0], spp), dtype=np.float32) * (1 / np.float32(spp))


def _check_path(
    scene: Scene, camera: Camera, still: RayCaster, bodies: Sequence[Body]
) -> Trajectory:
    """Return a scene's camera path, checked to keep clear of all surfaces."""
    trajectory, duration_s = scene.trajectory(camera), scene.duration_s
    rest = scene.min_clearance_m, scene.path_name
    check_clearance(trajectory.position, trajectory.knots_s, duration_s, still, *rest)
    _warn_if_far_from_origin(scene, camera, trajectory, still)
    if scene.plane is not None:
        for t_s in (0.0, duration_s):
            _check_plane(scene.plane, camera, trajectory.pose(t_s), still, scene.folder)
    for body in bodies:

        def place_in_body(t_s: Float64, body: Body = body) -> Float64:
            T = body.pose(t_s)
            from_body = trajectory.position(t_s) - T[..., :3, 3]
            return (from_body[..., None, :] @ T[..., :3, :3])[..., 0, :]

        knots_s = np.union1d(trajectory.knots_s, body.knots_s)
        check_clearance(place_in_body, knots_s, duration_s, body.caster, *rest, alone=True)
    return trajectory


def _warn_if_far_from_origin(
    scene: Scene, camera: Camera, trajectory: Trajectory, still: RayCaster
) -> None:
    """Warn where single precision, which Mitsuba renders in, makes the image jump."""
    T = trajectory.pose(np.linspace(0.0, scene.duration_s, _VIEWS))
    rays = camera.rays(camera.grid(_VIEWS))
    near_m = min(float(still.distance(pose[:3, 3], rays @ pose[:3, :3].T).min()) for pose in T)
    farthest_m = float(np.abs(T[:, :3, 3]).max())
    step_px = float(np.spacing(np.float32(farthest_m))) * max(camera.fx, camera.fy) / near_m
    if step_px > _MAX_ROUNDING_PX:
        _log.warning(
            "%s: the camera is %.3g m from the origin, where single precision moves the image in "
            "steps of %.2g px, above %g px: move the scene and its path to the origin",
            scene.path_name,
            farthest_m,
            step_px,
            _MAX_ROUNDING_PX,
        )


def _check_plane(
    plane: Plane, camera: Camera, T_world_cam: Float64, caster: RayCaster, folder: Path
) -> None:
    """Check that the camera looks at the plane of scene.toml, from which ground truth follows."""
    origin = T_world_cam[:3, 3]
    directions = camera.rays(camera.grid(_VIEWS)) @ T_world_cam[:3, :3].T
    to_plane = plane.distance(origin, directions)
    to_surface = caster.distance(origin, directions)
    meets = np.isfinite(to_plane)
    if missed := int(np.sum(meets & ~np.isfinite(to_surface))):
        raise SceneError(
            f"{folder / 'scene.toml'}: plane: {missed} of {np.sum(meets)} rays of the camera meet "
            "no surface; depth and flow need a surface on the plane"
        )
    ratio = float(np.median(to_surface[meets] / to_plane[meets])) if meets.any() else 1.0
    if abs(ratio - 1) > _OFF_PLANE:
        raise SceneError(
            f"{folder / 'scene.toml'}: plane: the visible surface is {ratio:.3g} times as far away "
            "as [plane]; depth and flow need them to coincide"
        )


def best_integrator(scene: Scene, variant: str) -> Integrator:
    """Return the default integrator, as `Renderer` documents it; log why if it is "path"."""
    if scene.settings.objects:
        _log.info("path tracing every frame of %s, as objects move in it", scene.name)
        return "path"
    if has_lightmaps(scene):
        return "baked"
    mi_scene = load_mi_scene(scene)  # kept: its meshes must not outlive it
    reflecting = surfaces(mi_scene)
    if not reflecting:
        return "emission"
    reasons = ((shape.id(), reason_not_to_bake(shape)) for shape in reflecting)
    reason = next((f"shape {name!r} {reason}" for name, reason in reasons if reason), "")
    if not reason and variant.startswith("scalar"):
        reason = f"{variant} cannot bake"
    reason = reason or reason_not_to_wait(mi_scene, scene)
    if not reason:
        return "baked"
    _log.info("path tracing every frame of %s, as %s", scene.name, reason)
    return "path"


def _to_world(T_world_cam: Float64) -> Any:
    import mitsuba as mi

    pose = np.asarray(T_world_cam, dtype=np.float64)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        text = pose.tolist() if pose.shape == (4, 4) else f"an array of shape {pose.shape}"
        raise RenderError(f"T_world_cam: found {text}, expected one finite (4, 4) pose")
    to_world = pose @ _CAM_FROM_MITSUBA
    return mi.ScalarTransform4f(to_world.tolist())


def _mitsuba_camera(
    camera: Camera, spp: int, only_pixel: tuple[int, int] | None = None
) -> dict[str, object]:
    """Return Mitsuba's description of a camera, for the image or one (column, row) of it."""
    import mitsuba as mi

    width, height, crop = camera.width, camera.height, {}
    if only_pixel is not None:
        column, row = only_pixel
        crop = {"crop_offset_x": column, "crop_offset_y": row, "crop_width": 1, "crop_height": 1}
    elif (2 * camera.cx, 2 * camera.cy) == (width, height) and "scalar" not in str(mi.variant()):
        # Rays depend on the shape alone, and their code, which holds the size, is then of any size.
        times = math.gcd(width, height)
        width, height = width // times, height // times
    return {
        "type": "perspective",
        "fov": float(np.rad2deg(camera.fov_rad)),
        "fov_axis": "x",
        "principal_point_offset_x": 0.5 - camera.cx / camera.width,
        "principal_point_offset_y": 0.5 - camera.cy / camera.height,
        "near_clip": NEAR_M,
        "film": {
            "type": "hdrfilm",
            "width": width,
            "height": height,
            "pixel_format": "luminance",
            "component_format": "float32",
            "rfilter": {"type": "box"},
            **crop,
        },
        "sampler": {"type": "multijitter", "sample_count": spp},
    }
