"""Ground truth at any resolution and time: depth, flow, visibility, moving objects, poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eres_render.camera import Camera, Plane, plane_homography
from eres_render.errors import SceneError
from eres_render.rendering.backend import select_variant
from eres_render.rendering.load import load_mi_scene
from eres_render.rendering.motion import Body, still_and_bodies
from eres_render.scene.load import load_scene
from eres_render.scene.objects import MovingObject
from eres_render.scene.scene import Scene
from eres_render.sequence.manifest import plane_values
from eres_render.sequence.sequence import RadianceSequence
from eres_render.trajectory.frame_times import Distance
from eres_render.trajectory.spline import Trajectory

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

# Along (N,) rays: the distance, and the number of the object.
_Seen = tuple[Float64, NDArray[np.uint8]]

_OCCLUDER_SHARE = 1e-3  # a surface nearer by less than this share of the distance hides nothing


@dataclass(frozen=True, eq=False, slots=True)
class Flow:
    """Motion of each pixel's surface point.

    Parameters
    ----------
    flow_px
        (H, W, 2) float32, x and y displacement of the point at the pixel's center. Zero where the
        point moves behind the camera.
    valid
        (H, W) bool: the point is inside the image at the second time, and visible.
    occluded
        (H, W) bool: the point is inside the image at the second time, and hidden.

    Examples
    --------
    The camera moves to the right, so the wall in view moves to the left and out of the image:

    >>> import numpy as np
    >>> from eres_render import Camera, GroundTruth, Plane, path_through
    >>> poses = np.tile(np.eye(4), (2, 1, 1))
    >>> poses[1, 0, 3] = 1.0
    >>> wall = Plane(normal=(0.0, 0.0, 1.0), offset_m=2.0)
    >>> path = path_through([0.0, 1.0], poses)
    >>> truth = GroundTruth(path, Camera(64, 48, fx=50), wall.distance, wall)
    >>> flow = truth.flow(0.0, 0.4, width=64)
    >>> flow.flow_px[24, 32], flow.valid[24, [5, 32]], bool(flow.occluded.any())
    (array([-10.,   0.], dtype=float32), array([False,  True]), False)
    """

    flow_px: Float32
    valid: NDArray[np.bool_]
    occluded: NDArray[np.bool_]


class GroundTruth:
    """Depth, flow, moving objects and poses of a camera on its path, at any time and resolution.

    For a plane they are exact. Rays to other surfaces are cast in single precision, with errors of
    about 1e-6 of the distance. Methods raise `TrajectoryError` for times off the path.

    Parameters
    ----------
    trajectory
        Path of the camera.
    camera
        The camera of the frames.
    distance
        Returns the distance along rays to the first surface that stands still.
    plane
        The plane, if the scene is planar.
    objects
        The moving objects.

    Examples
    --------
    A camera that moves 1 m/s to the right in front of a wall at 2 m; for a rendered clip,
    `ground_truth` returns one:

    >>> import numpy as np
    >>> from eres_render import Camera, GroundTruth, Plane, path_through
    >>> poses = np.tile(np.eye(4), (2, 1, 1))
    >>> poses[1, 0, 3] = 1.0
    >>> wall = Plane(normal=(0.0, 0.0, 1.0), offset_m=2.0)
    >>> path = path_through([0.0, 1.0], poses)
    >>> truth = GroundTruth(path, Camera(640, 480, fx=500), wall.distance, wall)
    >>> truth
    GroundTruth(640x480 px, 1 s)
    >>> depth = truth.depth(0.5, width=64)
    >>> depth.shape, float(depth[24, 32])
    ((48, 64), 2.0)
    >>> truth.flow(0.5, 0.6, width=64).flow_px[24, 32]  # 50 px/s * 0.1 s / 2 at this width
    array([-2.5,  0. ], dtype=float32)
    """

    def __init__(
        self,
        trajectory: Trajectory,
        camera: Camera,
        distance: Distance,
        plane: Plane | None = None,
        objects: Sequence[Body] = (),
    ) -> None:
        self.trajectory = trajectory
        self.plane = plane
        self.objects = tuple(objects)
        self._camera = camera
        self._distance = distance
        self._recent: dict[tuple[Camera, float], _Seen] = {}
        self._last_rays: tuple[Camera, Float64] | None = None

    def __repr__(self) -> str:
        size = f"{self._camera.width}x{self._camera.height} px"
        return f"GroundTruth({size}, {self.trajectory.duration_s:g} s)"

    def camera(self, width: int, height: int | None = None) -> Camera:
        """Return the camera at a resolution.

        It sees the whole frames, or with a given height their largest central part of that aspect
        ratio, as a sensor does; see `Camera.resized`.

        Parameters
        ----------
        width, height
            Size of the image, px.

        Returns
        -------
        camera
            Its `K` is the camera matrix. It has the lens of the frames.
        """
        return self._camera.resized(width, height)

    def of_camera(self, camera: Camera) -> GroundTruth:
        """Return the ground truth of another camera on the same path."""
        return GroundTruth(self.trajectory, camera, self._distance, self.plane, self.objects)

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
            (H, W) float32 z-depth at the centers of the pixels, m; inf without a surface.
        """
        camera = self.camera(width, height)
        depth, _ = self._seen_at_centers(camera, t_s)
        return depth.reshape(camera.height, camera.width).astype(np.float32)

    def instances(self, t_s: float, width: int, height: int | None = None) -> NDArray[np.uint8]:
        """Return which object each pixel sees at a time.

        Parameters
        ----------
        t_s
            Time on the path, s.
        width, height
            Size of the image, px; see `camera`.

        Returns
        -------
        instances
            (H, W) at the centers of the pixels: k for `objects[k - 1]`, 0 for all that stands still
            and for nothing.
        """
        camera = self.camera(width, height)
        _, number = self._seen_at_centers(camera, t_s)
        return number.reshape(camera.height, camera.width).copy()

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
        surface, rays = self._seen_at_centers(camera, t_0_s), self._center_rays(camera)
        flow, valid, occluded = self._flow(camera, camera.centers(), rays, surface, t_0_s, t_1_s)
        shape = camera.height, camera.width
        flow_px = flow.astype(np.float32).reshape(*shape, 2)
        return Flow(flow_px, valid.reshape(shape), occluded.reshape(shape))

    def point_flow(
        self, points_px: Float64, t_0_s: float, t_1_s: float, width: int, height: int | None = None
    ) -> tuple[Float64, NDArray[np.bool_]]:
        """Return the optical flow of the surface points at some pixels.

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
        rays = camera.rays(points_px)
        surface = self._seen(self.pose(t_0_s), t_0_s, rays)
        flow_px, valid, _ = self._flow(camera, points_px, rays, surface, t_0_s, t_1_s)
        return flow_px, valid

    def _flow(
        self,
        camera: Camera,
        points_px: Float64,
        rays: Float64,
        surface: _Seen,
        t_0_s: float,
        t_1_s: float,
    ) -> tuple[Float64, NDArray[np.bool_], NDArray[np.bool_]]:
        """Return the (N, 2) flow of points, and which are then visible and which hidden."""
        T_0, T_1 = self.trajectory.pose([t_0_s, t_1_s])
        depth, number = surface
        points = _over_depth(np.linalg.inv(T_1) @ T_0, rays, depth)
        for k, body in enumerate(self.objects, start=1):
            on = number == k
            before, after = body.pose([t_0_s, t_1_s])
            T = np.linalg.inv(T_1) @ after @ np.linalg.inv(before) @ T_0
            points[on] = _over_depth(T, rays[on], depth[on])
        ahead = points[:, 2] > 0
        points[~ahead] = 0.0, 0.0, 1.0
        projected = camera.project(points)
        side = (camera.width, camera.height)
        inside = ahead & np.all((projected >= 0) & (projected < side), axis=1)

        # A point is visible if no surface is nearer on the ray from the second pose to it; a point
        # at infinity, if the ray meets nothing.
        reach, _ = self._seen(T_1, t_1_s, points[inside])
        valid = inside.copy()
        valid[inside] = reach >= (1 - _OCCLUDER_SHARE) * depth[inside]
        return np.where(ahead[:, None], projected - points_px, 0.0), valid, inside & ~valid

    def homography(
        self, t_0_s: float, t_1_s: float, width: int, height: int | None = None
    ) -> Float64:
        """Return the matrix that takes homogeneous pixels from one time to another.

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
            If the scene is not a plane, or the camera has a lens; then there is no such matrix.
        """
        if self.plane is None:
            raise SceneError("a homography needs a planar scene, with a [plane]")
        if self._camera.distortion is not None:
            raise SceneError(
                f"a homography needs a pinhole camera, but the lens has {self._camera.distortion}; "
                "use point_flow, or plane_homography between undistorted positions"
            )
        T_0, T_1 = self.trajectory.pose([t_0_s, t_1_s])
        return plane_homography(self.camera(width, height).K, T_0, T_1, self.plane)

    def _seen_at_centers(self, camera: Camera, t_s: float) -> _Seen:
        """Return what all pixels see; the last two views are kept, for flow, depth and masks."""
        view = camera, float(t_s)
        if view not in self._recent:
            for old in list(self._recent)[:-1]:
                del self._recent[old]
            self._recent[view] = self._seen(self.pose(t_s), t_s, self._center_rays(camera))
        return self._recent[view]

    def _center_rays(self, camera: Camera) -> Float64:
        """Return the rays of all pixels; those of the last camera are kept."""
        if self._last_rays is None or self._last_rays[0] != camera:
            self._last_rays = camera, camera.rays(camera.centers())
        return self._last_rays[1]

    def _seen(self, T: Float64, t_s: float, rays_cam: Float64) -> _Seen:
        """Return the distance along rays of the camera at a pose, and the number of the object."""
        distance = self._distance(T[:3, 3], rays_cam @ T[:3, :3].T)
        number = np.zeros(len(rays_cam), np.uint8)
        for k, body in enumerate(self.objects, start=1):
            T_body_cam = np.linalg.inv(body.pose(t_s)) @ T
            reach = body.caster.distance(T_body_cam[:3, 3], rays_cam @ T_body_cam[:3, :3].T)
            nearer = reach < distance
            distance = np.where(nearer, reach, distance)
            number[nearer] = k
        return distance, number


def _over_depth(T: Float64, rays: Float64, depth: Float64) -> Float64:
    """Return points on (N, 3) rays after a motion, over their depth: at infinity they only turn."""
    return rays @ T[:3, :3].T + T[:3, 3] / depth[:, None]


def ground_truth(sequence: RadianceSequence) -> GroundTruth:
    """Return the ground truth of a sequence on disk.

    This loads its scene, and Mitsuba too if the scene has depth.

    Raises
    ------
    SceneError
        If the scene is missing, or has changed since the sequence was rendered.
    TrajectoryError
        If the path of an object cannot be read.

    Examples
    --------
    After `eres render carpet --resolution 128 --spp 4 --samples 1 --out clips`:

    >>> from eres_render import ground_truth, open_sequence
    >>> truth = ground_truth(open_sequence("clips/clip_000"))
    >>> flow = truth.flow(0.25, 0.3, width=64)
    >>> flow.flow_px.shape, bool(flow.valid.any())
    ((64, 64, 2), True)
    """
    manifest = sequence.manifest
    scene = load_scene(sequence.scene_source)
    if scene.light_digest != manifest.light_digest:
        raise SceneError(
            f"{scene.xml_file}: has changed since {sequence.folder} was rendered; render it again"
        )
    if manifest.plane is not None and manifest.plane != plane_values(scene):
        raise SceneError(
            f"{scene.folder / 'scene.toml'}: plane: has changed since {sequence.folder} was "
            "rendered; render it again"
        )
    objects = scene.objects(manifest.t_offset_us, manifest.t_s[-1])
    distance, bodies = surfaces(scene, objects)
    return GroundTruth(sequence.trajectory, sequence.camera, distance, scene.plane, bodies)


def surfaces(
    scene: Scene, objects: Sequence[MovingObject] = ()
) -> tuple[Distance, tuple[Body, ...]]:
    """Return the `Distance` to what stands still, in closed form for a plane, and moving bodies."""
    plane = scene.plane
    if plane is not None and not objects:
        return plane.distance, ()
    select_variant()
    still, bodies = still_and_bodies(scene, load_mi_scene(scene), objects)
    return (still if plane is None else plane).distance, bodies
