"""Compare looking up baked light with tracing where it gains least: small images, few samples.

Run: python benchmarks/bench_small_images.py

Prints a Markdown table of the CPU time of a traced frame over that of the same frame looked up:
the median of several rounds in turn, averaged over poses; "*" where `LookUp.pays` chooses tracing.
The scenes are carpet, room, and a wall behind many small triangles, every edge of which is drawn
into the map of pixels to trace.
"""

from __future__ import annotations

import copy
from typing import Any
from unittest import mock

import numpy as np
from bench_look_up import timed

from eres_render import Camera, Renderer, Scene, load_scene
from eres_render.rendering import renderer as renderer_module
from eres_render.rendering.lookup import LookUp

_WIDTHS, _SPP, _ROUNDS, _POSES = (64, 128, 256), (1, 2, 4, 16), 15, 2
_TRIANGLES = (300, 3000, 30_000)


def main() -> None:
    """Print the table."""
    import drjit as dr

    dr.set_thread_count(2)
    heads = ["scene", "edges", *(f"{w} px, {spp} spp" for w in _WIDTHS for spp in _SPP)]
    print("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")
    carpet = load_scene("carpet")
    print_row("carpet", Renderer(carpet, 64, 1, integrator="baked"))
    print_row("room", Renderer(load_scene("room"), 64, 1, integrator="baked"))
    for count in _TRIANGLES:
        print_row(f"{count:,} triangles", renderer_of(carpet, triangles(count)))


def print_row(name: str, renderer: Renderer) -> None:
    """Print the row of a scene."""
    look_up = renderer._look_up
    assert look_up is not None
    times_s = np.linspace(0.1, 0.9, _POSES) * renderer.scene.duration_s
    poses = renderer.scene.trajectory().pose(times_s)
    cells = [name, f"{len(look_up._surfaces.edges):,}"]
    for width in _WIDTHS:
        for spp in _SPP:
            looked_up = copy.copy(renderer)
            looked_up._use_camera(Camera(width, width, renderer.camera.fov_rad), spp)
            full = copy.copy(looked_up)
            full._look_up = None
            ratio = cost_ratio(full, looked_up, poses)
            cells.append(f"{ratio:.2f}{'' if look_up.pays(looked_up.camera, spp) else '*'}")
    print("| " + " | ".join(cells) + " |", flush=True)


def cost_ratio(full: Renderer, looked_up: Renderer, poses: np.ndarray) -> float:
    """Return the CPU time of tracing everything over that of looking up."""
    cost = np.zeros(2)
    with mock.patch.object(LookUp, "pays", return_value=True):
        for pose in poses:
            _ = full.frame(pose), looked_up.frame(pose)  # compile
            both = [[timed(one, pose).cpu_s for one in (full, looked_up)] for _ in range(_ROUNDS)]
            cost += np.median(both, axis=0)
    return float(cost[0] / cost[1])


def renderer_of(scene: Scene, world: dict[str, Any]) -> Renderer:
    """Return a renderer of another world, seen on a scene's path."""
    import mitsuba as mi

    loaded = mi.load_dict({"type": "scene", **world})
    with mock.patch.object(renderer_module, "baked_scene", return_value=(loaded, {"wall"})):
        return Renderer(scene, 64, 1, integrator="baked")


def triangles(count: int) -> dict[str, Any]:
    """Return a wall of 6 m in the plane z = 0 and triangles of 1 cm up to 1 m in front of it."""
    import mitsuba as mi

    rng = np.random.default_rng(0)
    texture = mi.Bitmap(rng.uniform(0.2, 1.0, (1024, 1024, 1)).astype(np.float32))
    radiance = {"type": "bitmap", "bitmap": texture, "raw": True, "format": "fp16"}
    wall = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().scale(3.0),
        "emitter": {"type": "area", "radiance": radiance | {"wrap_mode": "clamp"}},
    }
    properties = mi.Properties()
    light = {"type": "area", "radiance": {"type": "uniform", "value": 0.5}}
    properties["emitter"] = mi.load_dict(light)
    mesh = mi.Mesh("triangles", 3 * count, count, properties)
    center = rng.uniform([-1.5, -1.5, 0.1], [1.5, 1.5, 1.0], (count, 3))
    corners = center[:, None] + rng.normal(0, 0.005, (count, 3, 3))
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = corners.ravel().astype(np.float32)
    parameters["faces"] = np.arange(3 * count, dtype=np.uint32)
    parameters.update()
    return {"wall": wall, "triangles": mesh}


if __name__ == "__main__":
    main()
