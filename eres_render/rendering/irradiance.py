"""The light that falls on every part of every surface of a scene.

All surfaces are Lambertian: the light that arrives at a point, from all directions, decides the
light that leaves it. So the cells of lightmaps can carry light from surface to surface.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from eres_render.errors import BackendError, RenderError, SceneError
from eres_render.progress import Progress, silent
from eres_render.rendering.lambertian import reason_not_to_bake, surfaces
from eres_render.rendering.load import LUMINANCE, files_of, load_mi_scene
from eres_render.rendering.raycast import front
from eres_render.scene.scene import Scene

if TYPE_CHECKING:
    import mitsuba as mi

_log = logging.getLogger(__name__)

Float32 = NDArray[np.float32]

# Called with points on a surface, a sampler and a mask of valid points; returns the irradiance at
# each and whether it counts.
IrradianceOf = Callable[[Any, Any, Any], tuple[Any, Any]]

Size = tuple[float, float]  # along u and along v, m

_SAMPLES_AT_ONCE = 1 << 22  # limits the memory of one wavefront
_BOUNCES = 8  # between surfaces; light that halves at each has lost 99.6 % by then
_MIN_SAMPLES = 4
_PROBES = 1 << 14  # points at which a UV square is measured
_MAX_SQUEEZED = 3.0  # a texture against the surface under it, as on bodies of revolution
_MAX_CELLS = 1 << 26  # of a lightmap
_MAX_SAMPLES = 1 << 34  # of a scene that is baked by default: an hour on two cores
_PROBES_PER_POINT = 4  # rays that tell whether a point is covered
_MIN_SHARE = 1 / 64  # a cell with fewer points that count is too noisy to use


def irradiance_maps(
    scene: Scene, cell_m: float, spp: int, on_progress: Progress = silent
) -> dict[str, Float32]:
    """Return the mean irradiance, W m^-2, in each cell of each surface's UV square.

    First, rays to each lamp find the direct light of every cell. Then every surface emits the light
    that it reflects, and all cells gather the light of the emitting surfaces. This is repeated for
    each bounce: with few samples at first, and with all samples for the last bounce.
    Covered points, such as a floor under a table's leg, do not count. A cell in which no point
    counts copies the nearest cell with light of its own.

    Parameters
    ----------
    scene
        Scene to light.
    cell_m
        Approximate side of a cell on the surface, m: a UV square has whole cells each way.
    spp
        Samples in each cell, rounded up to a square. A sample is a position with a ray to every
        lamp, a ray that gathers light, and rays that test whether the position is covered.
    on_progress
        Called as samples are done.

    Returns
    -------
    maps
        From shape id to (rows, columns) float32; rows run along v, columns along u.

    Raises
    ------
    BackendError
        If the selected variant is scalar.
    SceneError
        If the scene has no light or moving objects, or a surface cannot be baked.
    """
    import mitsuba as mi

    refuse_objects(scene)
    if (variant := str(mi.variant())).startswith("scalar"):
        raise BackendError(
            f"{scene.name}: baking needs a vectorized Mitsuba variant, found {variant}; "
            "install LLVM (apt-get install libllvm19) or use lightmaps baked elsewhere"
        )
    start = time.perf_counter()
    mi_scene = load_mi_scene(scene)
    if not mi_scene.emitters():
        raise SceneError(f"{scene.xml_file}: found no light, expected an <emitter>")
    shapes = {shape.id(): shape for shape in bakeable_surfaces(mi_scene, scene)}
    sides = _sides(shapes, scene, cell_m)
    for name, (n_u, n_v) in sides.items():
        if n_u * n_v > _MAX_CELLS:
            raise SceneError(
                f"shape {name!r}: found a lightmap of {n_u} x {n_v} cells, expected at most "
                f"{_MAX_CELLS}: make bake.cell_m larger, let the shape fill more of the UV "
                "square, or render with --integrator path"
            )
    albedo = {
        name: _shrunk(reflectance(shape.bsdf(), scene), sides[name])
        for name, shape in shapes.items()
    }
    glowing = _glowing(scene, {name: np.zeros(a.shape, np.float32) for name, a in albedo.items()})
    work = _work(sides, spp)
    spp, few = _counts(spp)
    finished = 0

    def on_samples(done: int) -> None:
        nonlocal finished
        finished += done
        on_progress(f"baking {scene.name}", finished, work)

    def everywhere(light: IrradianceOf, samples: int, smooth: bool) -> dict[str, Float32]:
        return {
            name: _per_cell(shape, sides[name], samples, light, smooth, on_samples)
            for name, shape in shapes.items()
        }

    direct = everywhere(_light_of_lamps(mi_scene), spp, smooth=False)
    maps = direct
    for bounce in range(1, _BOUNCES + 1):
        glow = {name: albedo[name] * maps[name] / np.float32(np.pi) for name in maps}
        _set_glow(glowing, glow)
        light = _light_of_surfaces(glowing, set(shapes))
        reflected = everywhere(light, spp if bounce == _BOUNCES else few, smooth=True)
        maps = {name: direct[name] + reflected[name] for name in direct}
        if not any(irradiance.any() for irradiance in reflected.values()):
            break  # no surface sees another
    _log.info("baked %s in %.1f s", scene.name, time.perf_counter() - start)
    return maps


def refuse_objects(scene: Scene) -> None:
    """Refuse to bake a scene whose objects move, and with them shadows and reflected light."""
    if scene.settings.objects:
        raise SceneError(
            f"{scene.xml_file}: baked light does not follow moving objects "
            f"({', '.join(scene.settings.objects)}); render with --integrator path, the default "
            "for this scene"
        )


def reason_not_to_wait(mi_scene: mi.Scene, scene: Scene) -> str:
    """Return why a bakeable scene takes too long to bake by default; "" if it does not."""
    settings = scene.settings.bake
    shapes = {shape.id(): shape for shape in surfaces(mi_scene)}
    sides = _sides(shapes, scene, settings.cell_m)
    work = _work(sides, settings.spp)
    if work <= _MAX_SAMPLES:
        return ""
    name, (n_u, n_v) = max(sides.items(), key=lambda item: math.prod(item[1]))
    return (
        f"its lightmaps take {work:.1g} samples, hours to bake; the largest, of shape {name!r}, "
        f"has {n_u} x {n_v} cells: make the shape smaller, or bake.cell_m in scene.toml larger"
    )


def _sides(shapes: dict[str, mi.Shape], scene: Scene, cell_m: float) -> dict[str, tuple[int, int]]:
    """Return how many cells the lightmap of each shape has along u and along v."""
    sizes_m = _texture_sizes_m(scene)
    return {name: _cells(shape, cell_m, sizes_m) for name, shape in shapes.items()}


def _work(sides: dict[str, tuple[int, int]], spp: int) -> int:
    """Return the number of samples of all cells and bounces."""
    most, few = _counts(spp)
    return sum(map(math.prod, sides.values())) * (2 * most + (_BOUNCES - 1) * few)


def _counts(spp: int) -> tuple[int, int]:
    """Return the samples of a cell for lamps and the last bounce, and for each other bounce."""
    return _square(spp), _square(max(_MIN_SAMPLES, spp // 16))


def _square(spp: int) -> int:
    """Return the next square number, which the multijittered sampler lays out best."""
    return (math.isqrt(spp - 1) + 1) ** 2


def _cells(shape: mi.Shape, cell_m: float, sizes_m: dict[str, Size]) -> tuple[int, int]:
    """Return how many cells a shape's lightmap has along u and along v.

    The size of the UV square is the mean stretch of the parametrization over the shape, or the
    texture's in `sizes_m` if about the same, so that cells line up with the parts of an atlas. The
    texels of a print have the size of what it shows, not of the print.
    """
    size_m = _uv_size_m(shape)
    texture_m = sizes_m.get(shape.id(), size_m)
    squeezed = np.abs(np.log(np.array(texture_m) / size_m))
    if squeezed.max() < math.log(_MAX_SQUEEZED):
        size_m = texture_m
    # Mitsuba wants two texels each way of an image that changes.
    n_u, n_v = (max(2, round(side_m / cell_m)) for side_m in size_m)
    return n_u, n_v


def _uv_size_m(shape: mi.Shape) -> Size:
    """Return the mean stretch of a shape's parametrization along u and along v, m."""
    import drjit as dr
    import mitsuba as mi

    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, _PROBES)
    si: Any = shape.eval_parameterization(sampler.next_2d())
    valid = np.asarray(si.is_valid())
    if not valid.any():  # it covers hardly any of the UV square
        sample_position: Any = shape.sample_position  # its type stub has a different Float
        on_it = sample_position(0.0, sampler.next_2d())
        si = shape.eval_parameterization(mi.Point2f(on_it.uv))
        valid = np.asarray(si.is_valid())
    # Dr.Jit keeps a single value if those of all points are equal, as on a cylinder.
    stretches = (np.asarray(dr.norm(along), np.float64) for along in (si.dp_du, si.dp_dv))
    each = (np.broadcast_to(stretch, valid.shape) for stretch in stretches)
    u_m, v_m = (float(np.sum(stretch, where=valid) / valid.sum()) for stretch in each)
    return u_m, v_m


def _texture_sizes_m(scene: Scene) -> dict[str, Size]:
    """Return width and height of the UV square of each named shape with a texture made by us."""
    import mitsuba as mi

    files = scene.texture_files()
    recipes = {files[name]: recipe for name, recipe in scene.settings.textures.items()}
    config = mi.parser.ParserConfig(str(mi.variant()))
    with files_of(scene):
        nodes = list(mi.parser.parse_file(config, str(scene.xml_file), **files).nodes)

    def below(node: Any) -> list[Any]:
        reference: Any = mi.Properties.ResolvedReference
        return [nodes[v.index()] for _, v in node.props.items() if isinstance(v, reference)]

    sizes_m = {}
    for shape in (node for node in nodes if node.type == mi.ObjectType.Shape):
        for texture in (texture for bsdf in below(shape) for texture in below(bsdf)):
            recipe = recipes.get(texture.props.get("filename", ""))
            if recipe is not None:
                rows, columns = recipe.shape
                sizes_m[shape.props.id()] = (columns * recipe.texel_m, rows * recipe.texel_m)
    return sizes_m


def _per_cell(
    shape: mi.Shape,
    sides: tuple[int, int],
    spp: int,
    light: IrradianceOf,
    smooth: bool,
    on_samples: Callable[[int], None],
) -> Float32:
    """Return the mean of a light over each cell of a shape, (rows, columns).

    `smooth` includes the neighbors of each cell, as is right for light from large surfaces.
    """
    import drjit as dr
    import mitsuba as mi

    n_u, n_v = sides
    sampler = mi.load_dict({"type": "multijitter", "sample_count": spp})
    sampler.set_samples_per_wavefront(spp)
    cells_at_once = max(1, _SAMPLES_AT_ONCE // spp)
    total, count = np.zeros(n_u * n_v), np.zeros(n_u * n_v)
    most = 0  # points of a cell that are on the shape
    for first in range(0, n_u * n_v, cells_at_once):
        cells = min(cells_at_once, n_u * n_v - first)
        # Numbers that change from call to call are opaque, or Dr.Jit would compile each into a new
        # kernel, which takes longer to compile than to run.
        sampler.seed(dr.opaque(mi.UInt32, first), cells * spp)
        cell = dr.arange(mi.UInt32, cells * spp) // spp + dr.opaque(mi.UInt32, first)
        columns, rows = dr.opaque(mi.UInt32, n_u), dr.opaque(mi.UInt32, n_v)
        corner = mi.Point2f(mi.Float(cell % columns), mi.Float(cell // columns))
        uv = (corner + sampler.next_2d()) / mi.Point2f(mi.Float(columns), mi.Float(rows))
        si: Any = shape.eval_parameterization(uv)
        point = dr.zeros(mi.SurfaceInteraction3f)
        point.p, point.n, point.sh_frame = si.p, front(si), mi.Frame3f(si.sh_frame.n)
        valid = si.is_valid()
        sampler.schedule_state()
        # The kernel up to here is for this shape; the long one that follows serves all shapes.
        dr.eval(point, valid)
        irradiance, counts = light(point, sampler, valid)
        of_cell = np.broadcast_to(np.asarray(valid), cells * spp).reshape(cells, spp).sum(axis=1)
        most = max(most, int(of_cell.max()))
        irradiance = dr.block_sum(dr.select(counts, irradiance, 0.0), spp)
        counted = dr.block_sum(dr.select(counts, mi.Float(1), mi.Float(0)), spp)
        dr.eval(irradiance, counted)
        part = slice(first, first + cells)
        total[part], count[part] = np.asarray(irradiance), np.asarray(counted)
        on_samples(cells * spp)
    if most < _MIN_SHARE * spp:
        raise SceneError(
            f"shape {shape.id()!r}: fills less than 1/{round(1 / _MIN_SHARE)} of each of the "
            f"{n_u} x {n_v} cells of its lightmap: make bake.cell_m smaller, let the shape fill "
            "more of the UV square, or render with --integrator path"
        )
    sums, counts_2d = total.reshape(n_v, n_u), count.reshape(n_v, n_u)
    known = counts_2d >= _MIN_SHARE * spp
    if smooth:
        sums, counts_2d = _with_neighbors(sums * known), _with_neighbors(counts_2d * known)
    mean = np.divide(sums, counts_2d, out=np.zeros((n_v, n_u)), where=known)
    return _fill(mean, known).astype(np.float32)


def _outside(mi_scene: mi.Scene, point: Any, sampler: Any, valid: Any) -> Any:
    """Return which points are not covered, as a floor is under a table's leg.

    All rays from a covered point meet backs; a single back may show in a hollow object.
    """
    import drjit as dr
    import mitsuba as mi

    covered = valid
    for _ in range(_PROBES_PER_POINT):
        towards = point.sh_frame.to_world(mi.warp.square_to_cosine_hemisphere(sampler.next_2d()))
        hit = mi_scene.ray_intersect(point.spawn_ray(towards), active=covered)
        covered = covered & hit.is_valid() & (dr.dot(front(hit), towards) > 0)
    return valid & ~covered


def _light_of_lamps(mi_scene: mi.Scene) -> IrradianceOf:
    """Return the direct irradiance from the emitters, by one ray to each."""
    import drjit as dr
    import mitsuba as mi

    def light(point: Any, sampler: Any, valid: Any) -> tuple[Any, Any]:
        counts = _outside(mi_scene, point, sampler, valid)
        irradiance = mi.Float(0)
        for emitter in mi_scene.emitters():
            sample, weight = emitter.sample_direction(point, sampler.next_2d(), counts)
            cosine = dr.dot(sample.d, point.sh_frame.n)
            above = counts & (cosine > 0) & (dr.dot(sample.d, point.n) > 0) & (sample.pdf > 0)
            hidden = mi_scene.ray_test(point.spawn_ray_to(sample.p), above)
            irradiance += dr.select(above & ~hidden, weight[0] * cosine, 0.0)
        return irradiance, counts

    return light


def _light_of_surfaces(glowing: mi.Scene, names: set[str]) -> IrradianceOf:
    """Return the irradiance from the glowing surfaces of these names."""
    import drjit as dr
    import mitsuba as mi

    lamps = [mi.ShapePtr(shape) for shape in glowing.shapes() if shape.id() not in names]

    def light(point: Any, sampler: Any, valid: Any) -> tuple[Any, Any]:
        counts = _outside(glowing, point, sampler, valid)
        towards = point.sh_frame.to_world(mi.warp.square_to_cosine_hemisphere(sampler.next_2d()))
        hit = glowing.ray_intersect(point.spawn_ray(towards), active=counts)
        surface = counts & hit.is_valid()  # an emitter is black from behind
        for lamp in lamps:
            surface &= hit.shape != lamp
        radiance = hit.emitter(glowing).eval(hit, surface)
        return dr.select(surface, dr.pi * radiance[0], 0.0), counts

    return light


def _glowing(scene: Scene, radiance: dict[str, Float32]) -> mi.Scene:
    """Load the scene with glowing surfaces, radiances as (rows, columns) over the UV square."""
    return load_mi_scene(scene, {name: glow_of(image) for name, image in radiance.items()})


def glow_of(radiance: Float32, **options: str) -> Any:
    """Return an emitter with the radiance of an image (rows, columns) over the UV square."""
    import mitsuba as mi

    bitmap = {"type": "bitmap", "bitmap": mi.Bitmap(radiance[..., None]), "raw": True}
    texture = bitmap | {"wrap_mode": "clamp"} | options
    return mi.load_dict({"type": "area", "radiance": texture})


def _set_glow(glowing: mi.Scene, radiance: dict[str, Float32]) -> None:
    """Change the radiances of a glowing scene."""
    import mitsuba as mi

    parameters = mi.traverse(glowing)
    for name, image in radiance.items():
        parameters[f"{name}.emitter.radiance.data"] = mi.TensorXf(image[..., None])
    parameters.update()


def _shrunk(image: Float32, sides: tuple[int, int]) -> Float32:
    """Return the image at (columns, rows) pixels, each the mean of its area."""
    small = cv2.resize(image, sides, interpolation=cv2.INTER_AREA)
    return small.astype(np.float32, copy=False)


def _with_neighbors(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sum over each pixel and the eight around it; 0 beyond the edge."""
    outside = cv2.BORDER_CONSTANT
    return cv2.boxFilter(image, -1, (3, 3), normalize=False, borderType=outside).astype(np.float64)


def _fill(image: NDArray[np.float64], known: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the image with every unknown cell replaced by the nearest known one."""
    if not known.any():
        return image
    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return image[tuple(nearest)]


def bakeable_surfaces(mi_scene: mi.Scene, scene: Scene) -> list[mi.Shape]:
    """Return the shapes that reflect light; refuse a scene with a shape that cannot be baked."""
    shapes = surfaces(mi_scene)
    for shape in shapes:
        if reason := reason_not_to_bake(shape):
            raise SceneError(
                f"{scene.xml_file}: cannot be baked: shape {shape.id()!r} {reason}; path-trace it "
                "(--integrator path)"
            )
    return shapes


def reflectance(bsdf: mi.BSDF, scene: Scene) -> Float32:
    """Return the reflectance of a diffuse material, (H, W), or (1, 1) if it is uniform."""
    import mitsuba as mi

    parameters = mi.traverse(bsdf)
    for key in parameters.keys():  # noqa: SIM118 - not a mapping
        if key.endswith("reflectance.data"):
            texels = np.asarray(parameters[key], dtype=np.float32)
            colored = texels.shape[2] == 3
            return texels @ LUMINANCE.astype(np.float32) if colored else texels[:, :, 0]
        if key.endswith("reflectance.value"):
            value = np.mean(np.asarray(parameters[key], dtype=np.float32))
            return np.full((1, 1), value, dtype=np.float32)
    raise RenderError(f"{scene.xml_file}: material {bsdf.id()!r}: found no reflectance")
