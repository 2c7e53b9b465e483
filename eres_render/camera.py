"""The camera, with or without a lens, and the homography between two pinhole views of a plane.

Camera axes as in OpenCV: x right, y down, z forward. Pixel centers lie at integers + 0.5, so (0, 0)
is the top-left corner of the image and (width, height) its bottom-right corner.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eres_render.distortion import Distortion
from eres_render.errors import RenderError

Float64 = NDArray[np.float64]

_BORDER = 65  # pixels along each side of the image at which the lens is checked


@dataclass(frozen=True, slots=True, init=False)
class Camera:
    """A camera: the size of its image, focal lengths, principal point and the lens's distortion.

    By default it is a pinhole, pixels are square and the principal point is the center of the
    image.

    Parameters
    ----------
    width, height
        Size of the image in pixels.
    fov_rad
        Horizontal field of view without the lens's distortion, for a centered principal point:
        `2 atan(width / (2 fx))`. Give it or `fx`.
    fx, fy
        Focal lengths in pixels.
    cx, cy
        Principal point in pixels. OpenCV's is half a pixel less, since it counts from the center of
        the first pixel.
    distortion
        Distortion of the lens. None, or a distortion with all coefficients 0, is a pinhole.

    Raises
    ------
    RenderError
        If the image has no pixels, a value is out of range, `fov_rad` and `fx` contradict each
        other, or the lens folds the image: two directions have the same pixel.

    Examples
    --------
    The camera of the packaged scenes, 60 degrees across 1280 px:

    >>> import math
    >>> from eres_render import Camera
    >>> camera = Camera(1280, 720, math.radians(60))
    >>> round(camera.fx, 1), camera.cx, camera.cy
    (1108.5, 640.0, 360.0)
    >>> camera.project([0.1, 0.0, 1.0]).round(1)  # 10 cm to the right, 1 m ahead
    array([750.9, 360. ])
    >>> camera.rays([640.0, 360.0])
    array([0., 0., 1.])

    The same with a lens:

    >>> from eres_render import Distortion
    >>> camera = Camera(1280, 720, math.radians(60), distortion=Distortion(k1=-0.3, k2=0.1))
    >>> pixel = camera.project([0.4, 0.0, 1.0])
    >>> pixel.round(1), camera.rays(pixel).round(12)
    (array([1063.3,  360. ]), array([0.4, 0. , 1. ]))
    """

    width: int
    height: int
    fov_rad: float
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: Distortion | None

    def __init__(
        self,
        width: int,
        height: int,
        fov_rad: float | None = None,
        *,
        fx: float | None = None,
        fy: float | None = None,
        cx: float | None = None,
        cy: float | None = None,
        distortion: Distortion | None = None,
    ) -> None:
        _check_size(width, height)
        above = {"fx": 0.0, "fy": 0.0, "cx": -math.inf, "cy": -math.inf}
        for (name, low), given in zip(above.items(), (fx, fy, cx, cy), strict=True):
            if given is not None and not low < given < math.inf:
                raise RenderError(f"Camera.{name}: found {given}, not in ({low:g}, inf)")
        if not isinstance(distortion, Distortion | None):
            raise RenderError(
                f"Camera.distortion: found {distortion!r}, expected Distortion(k1, k2, p1, p2, k3)"
            )
        if fov_rad is None:
            if fx is None:
                raise RenderError("Camera: needs fov_rad or fx, and has neither")
            fov_rad = 2 * math.atan2(0.5 * width, fx)
        views = {"fov_rad": fov_rad, "fy": 2 * math.atan2(0.5 * height, fy) if fy else fov_rad}
        for name, view_rad in views.items():
            if not 0 < view_rad < math.pi:
                raise RenderError(f"Camera.{name}: the view of {view_rad} rad is not in (0, pi)")
        fx_of_fov = 0.5 * width / math.tan(0.5 * fov_rad)
        if fx is None:
            fx = fx_of_fov
        elif not math.isclose(fx, fx_of_fov, rel_tol=1e-6):
            raise RenderError(
                f"Camera.fx: {fx} contradicts fov_rad = {fov_rad} (fx = {fx_of_fov}); give one"
            )
        fy = fx if fy is None else fy
        center = 0.5 * width if cx is None else cx, 0.5 * height if cy is None else cy
        # Python's numbers, for JSON.
        values = int(width), int(height), *map(float, (fov_rad, fx, fy, *center))
        lens = None if distortion == Distortion() else distortion
        for name, value in zip(Camera.__slots__, (*values, lens), strict=True):
            object.__setattr__(self, name, value)
        if self.distortion is not None:
            self._check_lens(self.distortion)

    def _check_lens(self, lens: Distortion) -> None:
        """Refuse a lens that folds the image; if it does not on the border, it does not inside."""
        grid = self.grid(_BORDER).reshape(_BORDER, _BORDER, 2)
        border = np.concatenate([grid[0], grid[-1], grid[:, 0], grid[:, -1]])
        with np.errstate(over="ignore", invalid="ignore"):
            xy = lens.undistort((border - (self.cx, self.cy)) / (self.fx, self.fy))
            radius = np.hypot(*xy.T)
        if radius.max() < lens.reach:
            return
        worst = radius.argmax()
        fold = lens.distort(xy[worst] * (lens.reach / radius[worst])) * (self.fx, self.fy)
        raise RenderError(
            f"Camera.distortion: {lens} folds the image onto itself {np.hypot(*fold):.1f} px from "
            "the principal point, but the image reaches out to "
            f"{np.hypot(*(border[worst] - (self.cx, self.cy))):.1f} px"
        )

    @property
    def focal_px(self) -> float:
        """Mean focal length in pixels; 1108.5 for 60 degrees across 1280 square pixels."""
        return 0.5 * (self.fx + self.fy)

    @property
    def K(self) -> Float64:
        """The (3, 3) matrix from camera coordinates to homogeneous pixels, without distortion."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def project(self, points_cam: ArrayLike) -> Float64:
        """Project points to the image, with the lens's distortion.

        Parameters
        ----------
        points_cam
            (..., 3) points in camera coordinates, z > 0, m.

        Returns
        -------
        points_px
            (..., 2) pixels.

        Raises
        ------
        RenderError
            If a point is not in front of the camera.
        """
        points_cam = np.asarray(points_cam, dtype=np.float64)
        if not np.all(points_cam[..., 2] > 0):
            raise RenderError(
                "Camera.project: found a point with z <= 0, expected points in front of the camera"
            )
        if self.distortion is not None:
            xy = self.distortion.distort(points_cam[..., :2] / points_cam[..., 2:])
            return xy * (self.fx, self.fy) + (self.cx, self.cy)
        return (self.fx, self.fy) * points_cam[..., :2] / points_cam[..., 2:] + (self.cx, self.cy)

    def rays(self, points_px: ArrayLike) -> Float64:
        """Return the directions in which pixels look, through the lens.

        Parameters
        ----------
        points_px
            (..., 2) pixels.

        Returns
        -------
        rays
            (..., 3) directions in camera coordinates, z = 1.
        """
        points_px = np.asarray(points_px, dtype=np.float64)
        xy = (points_px - (self.cx, self.cy)) / (self.fx, self.fy)
        if self.distortion is not None:
            xy = self.distortion.undistort(xy)
        return np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1)

    def distort(self, pinhole_px: ArrayLike) -> Float64:
        """Map pixels of a pinhole with the same `K` to this camera's pixels of the same directions.

        Parameters
        ----------
        pinhole_px
            (..., 2) pixels of the pinhole.

        Returns
        -------
        points_px
            (..., 2) pixels of this camera.
        """
        pinhole_px = np.asarray(pinhole_px, dtype=np.float64)
        if self.distortion is None:
            return pinhole_px
        xy = (pinhole_px - (self.cx, self.cy)) / (self.fx, self.fy)
        return self.distortion.distort(xy) * (self.fx, self.fy) + (self.cx, self.cy)

    def undistort(self, points_px: ArrayLike) -> Float64:
        """Map pixels to a pinhole's pixels of the same directions; it has the same `K`.

        Parameters
        ----------
        points_px
            (..., 2) pixels of this camera.

        Returns
        -------
        pinhole_px
            (..., 2) pixels of the pinhole; they may lie outside the image.
        """
        points_px = np.asarray(points_px, dtype=np.float64)
        if self.distortion is None:
            return points_px
        return self.rays(points_px)[..., :2] * (self.fx, self.fy) + (self.cx, self.cy)

    def undistorted_positions(self) -> Float64:
        """Return a table that undistorts events: `table[y, x]` is their position in a pinhole.

        Returns
        -------
        table
            (height, width, 2) pixels of a pinhole with the same `K`, as `undistort` finds them for
            the centers of all pixels; read-only, and kept for the next call.

        Examples
        --------
        >>> import numpy as np
        >>> from eres_render import Camera, Distortion
        >>> camera = Camera(640, 480, fx=500.0, distortion=Distortion(k1=-0.2))
        >>> x, y = np.array([0, 319]), np.array([0, 239])  # of two events
        >>> camera.undistorted_positions()[y, x].round(3)
        array([[-78.682, -58.856],
               [319.5  , 239.5  ]])
        """
        return _undistorted_positions(self)

    def cropped(self, left: int, top: int, width: int, height: int) -> Camera:
        """Return the camera whose image is a part of this camera's, pixel by pixel.

        Parameters
        ----------
        left, top
            First column and row of the part, px; it may lie outside the image.
        width, height
            Size of the part, px.

        Returns
        -------
        camera
            It shows at (x, y) what this camera shows at (x + left, y + top), through the same lens.

        Raises
        ------
        RenderError
            If the part has no pixels, or the lens folds it.

        Examples
        --------
        >>> from eres_render import Camera
        >>> part = Camera(1280, 1280, fx=1000.0).cropped(0, 280, 1280, 720)
        >>> part.height, part.fx, part.cx, part.cy
        (720, 1000.0, 640.0, 360.0)
        """
        moved = {"cx": self.cx - left, "cy": self.cy - top}
        return Camera(width, height, fx=self.fx, fy=self.fy, **moved, distortion=self.distortion)

    def resized(self, width: int, height: int | None = None) -> Camera:
        """Return the camera at a different resolution.

        By default it sees all that this camera sees, and its height gives pixels of the same shape,
        to within rounding. With a given height it sees the largest central part of that aspect
        ratio, as a sensor does.

        Parameters
        ----------
        width, height
            Size of the image, px.

        Returns
        -------
        camera
            The camera, with the same lens.

        Raises
        ------
        RenderError
            If the image has no pixels.

        Examples
        --------
        >>> from eres_render import Camera
        >>> half = Camera(1280, 720, fx=1000.0, cx=650.0).resized(640)
        >>> half.height, round(half.fx, 6), round(half.cx, 6), half.cy
        (360, 500.0, 325.0, 180.0)
        """
        _check_size(width, 1 if height is None else height)
        fov_rad, stretch = self.fov_rad, 1.0
        if height is None:
            height = max(1, round(width * self.height / self.width))
            stretch = height * self.width / (self.height * width)
        elif (share := self.height * width / (self.width * height)) < 1:  # of this width
            fov_rad = 2 * math.atan(share * math.tan(0.5 * fov_rad))
        fx = Camera(width, height, fov_rad).fx
        fy = fx * (self.fy / self.fx) * stretch
        return Camera(
            width,
            height,
            fov_rad,
            fy=fy,
            cx=0.5 * width + fx / self.fx * (self.cx - 0.5 * self.width),
            cy=0.5 * height + fy / self.fy * (self.cy - 0.5 * self.height),
            distortion=self.distortion,
        )

    def zoomed(self, times: float) -> Camera:
        """Return the camera with longer focal lengths.

        Parameters
        ----------
        times
            Factor on the focal lengths. At `times` the distance, a pinhole camera that faces a
            plane sees the same in each pixel as before.

        Returns
        -------
        camera
            It has the same size, principal point and distortion.

        Raises
        ------
        RenderError
            If the focal lengths are not positive numbers, or the lens folds the image.

        Examples
        --------
        >>> from eres_render import Camera
        >>> camera = Camera(640, 480, fx=500.0)
        >>> camera.project([0.1, 0.0, 1.0]), camera.zoomed(2.0).project([0.1, 0.0, 2.0])
        (array([370., 240.]), array([370., 240.]))
        """
        fx, fy, center = times * self.fx, times * self.fy, {"cx": self.cx, "cy": self.cy}
        return Camera(self.width, self.height, fx=fx, fy=fy, **center, distortion=self.distortion)

    def grid(self, n: int) -> Float64:
        """Return (n * n, 2) pixels that span the image evenly, its corners included."""
        x, y = np.meshgrid(np.linspace(0, self.width, n), np.linspace(0, self.height, n))
        return np.stack([x.ravel(), y.ravel()], axis=-1)

    def centers(self) -> Float64:
        """Return the (height * width, 2) centers of all pixels, row by row."""
        x, y = np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5)
        return np.stack([x.ravel(), y.ravel()], axis=-1)


def _check_size(width: int, height: int) -> None:
    whole = all(isinstance(side, (int, np.integer)) for side in (width, height))
    if not whole or width < 1 or height < 1:
        raise RenderError(
            f"Camera: found {width!r}x{height!r} pixels, expected whole numbers of at least 1"
        )


@functools.lru_cache(maxsize=2)
def _undistorted_positions(camera: Camera) -> Float64:
    table = camera.undistort(camera.centers()).reshape(camera.height, camera.width, 2)
    table.flags.writeable = False
    return table


@dataclass(frozen=True, slots=True)
class Plane:
    """The points X with `normal . X = offset_m`, in world coordinates; the normal has length 1.

    Parameters
    ----------
    normal
        Unit vector.
    offset_m
        Distance from the origin along the normal, m.

    Raises
    ------
    RenderError
        If the normal is not a vector of length 1.

    Examples
    --------
    >>> import numpy as np
    >>> from eres_render import Plane
    >>> wall = Plane(normal=(0.0, 0.0, 1.0), offset_m=2.0)
    >>> wall.intersect(np.zeros(3), np.array([0.1, 0.0, 1.0]))
    array([0.2, 0. , 2. ])
    """

    normal: tuple[float, float, float]
    offset_m: float

    def __post_init__(self) -> None:
        normal = tuple(map(float, self.normal))
        if len(normal) != 3 or not math.isclose(math.hypot(*normal), 1.0, abs_tol=1e-9):
            raise RenderError(f"Plane.normal: found {normal}, expected a vector of length 1")
        # An array has no hash, and == gives an array.
        object.__setattr__(self, "normal", normal)
        object.__setattr__(self, "offset_m", float(self.offset_m))

    def distance(self, origin: ArrayLike, direction: ArrayLike) -> Float64:
        """Return the distance along rays to the plane.

        Parameters
        ----------
        origin
            (..., 3) starts of the rays, m.
        direction
            (..., 3), of any length.

        Returns
        -------
        distance
            (...) in units of the directions' lengths; inf for rays that do not run toward it.
        """
        origin, direction = np.asarray(origin), np.asarray(direction)
        n = np.asarray(self.normal)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = np.asarray((self.offset_m - origin @ n) / (direction @ n))
        return np.where(distance > 0, distance, np.inf)

    def intersect(self, origin: ArrayLike, direction: ArrayLike) -> Float64:
        """Return where rays meet the plane.

        Parameters
        ----------
        origin
            (..., 3) starts of the rays, m.
        direction
            (..., 3), of any length.

        Returns
        -------
        points
            (..., 3) m.

        Raises
        ------
        RenderError
            If a ray does not run toward the plane.
        """
        distance = self.distance(origin, direction)
        if not np.all(np.isfinite(distance)):
            raise RenderError("Plane.intersect: a ray does not run toward the plane")
        points: Float64 = np.asarray(origin) + distance[..., None] * np.asarray(direction)
        return points


def plane_homography(
    K: Float64, T_world_cam_0: Float64, T_world_cam_1: Float64, plane: Plane
) -> Float64:
    """Return the matrix that takes homogeneous pixels of view 0 to view 1, through a plane.

    `H = K (R + t n^T / d) K^-1`, with (R, t) the motion from camera 0 to camera 1 and (n, d) the
    plane in camera 0 (Hartley and Zisserman 2004, eq. 13.2).

    Parameters
    ----------
    K
        (3, 3).
    T_world_cam_0, T_world_cam_1
        (..., 4, 4), broadcast against each other.
    plane
        In world coordinates. Camera 0 must not lie in it.

    Returns
    -------
    H
        (..., 3, 3), defined up to scale; positive third coordinates are in front of camera 1.

    Examples
    --------
    A camera that moves 10 cm to the right sees a wall 2 m away move to the left, by `fx * 0.1 / 2`:

    >>> import numpy as np
    >>> from eres_render import Camera, Plane, plane_homography
    >>> before, after = np.eye(4), np.eye(4)
    >>> after[0, 3] = 0.1
    >>> wall = Plane(normal=(0.0, 0.0, 1.0), offset_m=2.0)
    >>> H = plane_homography(Camera(640, 480, fx=500).K, before, after, wall)
    >>> (H @ [320, 240, 1]).round(6)
    array([295., 240.,   1.])
    """
    R0, p0 = T_world_cam_0[..., :3, :3], T_world_cam_0[..., :3, 3]
    R1, p1 = T_world_cam_1[..., :3, :3], T_world_cam_1[..., :3, 3]
    R1_inv = np.swapaxes(R1, -1, -2)
    R = R1_inv @ R0
    t = R1_inv @ (p0 - p1)[..., None]
    n_world = np.asarray(plane.normal)
    n = np.swapaxes(R0, -1, -2) @ n_world
    d = plane.offset_m - p0 @ n_world
    return K @ (R + t * (n / d[..., None])[..., None, :]) @ np.linalg.inv(K)


def map_pixels(H: Float64, points_px: Float64) -> Float64:
    """Map (N, 2) pixels by a homography, (..., 3, 3), to (..., N, 2) pixels."""
    mapped = points_px @ np.swapaxes(H[..., :2], -1, -2) + H[..., None, :, 2]
    return mapped[..., :2] / mapped[..., 2:]
