"""Ground truth at any resolution and time: depth, optical flow, visibility, poses."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eres_render.camera import Camera, Plane, plane_homography
from eres_render.errors import SceneError
from eres_render.rendering.backend import select_variant
from eres_render.rendering.load import load_mi_scene
from eres_render.rendering.raycast import RayCaster
from eres_render.scene.load import load_scene
from eres_render.scene.scene import Scene
from eres_render.sequence.sequence import RadianceSequence
from eres_render.trajectory.spline import Trajectory

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

# Distance from a (3,) origin along (N, 3) rays to the first surface: (N,) in units of each ray's
# length, inf where there is none.
Distance = Callable[[Float64, Float64], Float64]

_OCCLUDER_SHARE = 1e-3  # a surface nearer by less than this share of the distance hides nothing


@dataclass(frozen=True, eq=False, slots=True)
class Flow:
    """Motion of each pixel's surface point.

    Parameters
    ----------
    flow_px
        (H, W, 2) float32, x and y displacement of the point seen at the pixel's center. Zero where
        the point moves behind the camera.
    valid
        (H, W) bool: the point is inside the image at the second time, and visible.
    """

    flow_px: Float32
    valid: NDArray[np.bool_]


class GroundTruth:
    """Depth, optical flow and poses of a camera on its path, at any time and resolution.

    In a planar scene everything is in closed form. Otherwise rays are cast in single precision,
    with errors of about 1e-6 of the distance.

    Parameters
    ----------
    trajectory
        Path of the camera.
    camera
        The camera of the frames.
    distance
        Gives the distance along rays to the first surface.
    plane
        All that the camera sees, in a planar scene.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        camera: Camera,
        distance: Distance,
        plane: Plane | None = None,
    ) -> None:
        self.trajectory = trajectory
        self.plane = plane
        self._camera = camera
        self._distance = distance

    def camera(self, width: int, height: int | None = None) -> Camera:
        """Return the camera at a resolution.

        By default it sees all of the frames, at the height that makes its pixels as square as
        theirs, to within rounding. With a given height it sees the largest central part of them
        that has its shape, as a sensor does.

        Parameters
        ----------
        width, height
            Size of the image, px.

        Returns
        -------
        camera
            Its `K` is the camera matrix.
        """
        whole = self._camera
        fov_rad, stretch = whole.fov_rad, 1.0
        if height is None:
            height = round(width * whole.height / whole.width)
            stretch = height * whole.width / (whole.height * width)
        else:
            share = whole.height * width / (whole.width * height)  # of the frames' width, if < 1
            if share < 1:
                fov_rad = 2 * math.atan(share * math.tan(0.5 * fov_rad))
        fx = Camera(width, height, fov_rad).fx
        fy = fx * (whole.fy / whole.fx) * stretch
        return Camera(
            width,
            height,
            fov_rad,
            fy=fy,
            cx=0.5 * width + fx / whole.fx * (whole.cx - 0.5 * whole.width),
            cy=0.5 * height + fy / whole.fy * (whole.cy - 0.5 * whole.height),
        )

    def pose(self, t_s: float) -> Float64:
        """Return T_world_cam, (4, 4), at a time on the path in seconds."""
        return self.trajectory.pose(t_s)

    def depth(self, t_s: float, width: int, height: int | None = None) -> Float32:
        """Return the depth at a time.

        Parameters
        ----------
        t_s
            Time on the path, s.
        width, height
            Size of the image, px; see `camera`.

        Returns
        -------
        depth
            (H, W) float32 z-depth at the centers of the pixels, m; inf where nothing is
            seen.
        """
        camera, T = self.camera(width, height), self.pose(t_s)
        depth = self._depth(T, camera.rays(camera.centers()))
        return depth.reshape(camera.height, camera.width).astype(np.float32)

    def flow(self, t_0_s: float, t_1_s: float, width: int, height: int | None = None) -> Flow:
        """Return the optical flow from one time to another.

        Parameters
        ----------
        t_0_s, t_1_s
            Times on the path, s; the second may be earlier.
        width, height
            Size of the image, px; see `camera`.

        Returns
        -------
        flow
            At the centers of the pixels.
        """
        camera = self.camera(width, height)
        flow, valid = self.point_flow(camera.centers(), t_0_s, t_1_s, width, height)
        shape = camera.height, camera.width
        return Flow(flow.astype(np.float32).reshape(*shape, 2), valid.reshape(shape))

    def point_flow(
        self,
        points_px: Float64,
        t_0_s: float,
        t_1_s: float,
        width: int,
        height: int | None = None,
    ) -> tuple[Float64, NDArray[np.bool_]]:
        """Return the optical flow of the surface points seen at some pixels.

        Parameters
        ----------
        points_px
            (N, 2) pixels of an image of that size.
        t_0_s, t_1_s
            Times on the path, s; the second may be earlier.
        width, height
            Size of the image, px; see `camera`.

        Returns
        -------
        flow_px
            (N, 2) displacements; zero where the point moves behind the camera.
        valid
            (N,) whether the point is inside the image at the second time, and visible.
        """
        camera = self.camera(width, height)
        T_0, T_1 = self.trajectory.pose([t_0_s, t_1_s])
        rays = camera.rays(points_px)
        depth = self._depth(T_0, rays)
        # Points over their depth, so that points at infinity only turn.
        T = np.linalg.inv(T_1) @ T_0
        points = rays @ T[:3, :3].T + T[:3, 3] / depth[:, None]
        ahead = points[:, 2] > 0
        points[~ahead] = 0.0, 0.0, 1.0
        there = camera.project(points)
        side = (camera.width, camera.height)
        valid = ahead & np.all((there >= 0) & (there < side), axis=1)

        # A point is visible if no surface is nearer on the ray from the second pose to it; a point
        # at infinity, if the ray meets nothing.
        way = points[valid] @ T_1[:3, :3].T
        reach = self._distance(T_1[:3, 3], way)
        valid[valid] = reach >= (1 - _OCCLUDER_SHARE) * depth[valid]
        return np.where(ahead[:, None], there - points_px, 0.0), valid

    def homography(
        self, t_0_s: float, t_1_s: float, width: int, height: int | None = None
    ) -> Float64:
        """Return the matrix that takes homogeneous pixels at one time to those at another.

        Parameters
        ----------
        t_0_s, t_1_s
            Times on the path, s; the second may be earlier.
        width, height
            Size of the image, px; see `camera`.

        Returns
        -------
        H
            (3, 3); see `plane_homography`.

        Raises
        ------
        SceneError
            If the scene is not a plane.
        """
        if self.plane is None:
            raise SceneError("a homography needs a planar scene, one with a [plane]")
        T_0, T_1 = self.trajectory.pose([t_0_s, t_1_s])
        return plane_homography(self.camera(width, height).K, T_0, T_1, self.plane)

    def _depth(self, T_world_cam: Float64, rays_cam: Float64) -> Float64:
        return self._distance(T_world_cam[:3, 3], rays_cam @ T_world_cam[:3, :3].T)


def ground_truth(sequence: RadianceSequence) -> GroundTruth:
    """Return the ground truth of a sequence on disk.

    This loads its scene, and if that has depth, Mitsuba.

    Raises
    ------
    SceneError
        If the scene is missing, or its surfaces have changed since the sequence was rendered.
    """
    manifest = sequence.manifest
    scene = load_scene(manifest.scene_source)
    if scene.light_digest != manifest.light_digest:
        raise SceneError(
            f"{scene.xml_file}: has changed since {sequence.folder} was rendered; render it again"
        )
    return GroundTruth(sequence.trajectory, sequence.camera, surface_distance(scene), scene.plane)


def surface_distance(scene: Scene) -> Distance:
    """Return a function for the distance to a scene's surfaces, in closed form for a plane."""
    if (plane := scene.plane) is not None:
        return plane.distance
    select_variant()
    caster = RayCaster(load_mi_scene(scene))
    return lambda origin, rays: caster.cast(origin, rays).distance
