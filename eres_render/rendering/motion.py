"""The moving objects of a scene in Mitsuba: placed for a frame, and as bodies that rays meet."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eres_render.errors import SceneError
from eres_render.rendering.load import load_mi_scene
from eres_render.rendering.raycast import RayCaster
from eres_render.scene.objects import MovingObject
from eres_render.scene.scene import Scene

Float64 = NDArray[np.float64]


class PlacedObjects:
    """Moves the shapes of a loaded scene to where its objects are at a time."""

    def __init__(self, mi_scene: Any, objects: Sequence[MovingObject], scene_file: object) -> None:
        import mitsuba as mi

        self._parameters = mi.traverse(mi_scene)
        self._movers: list[tuple[MovingObject, Callable[[Float64], None]]] = []
        shapes = {shape.id(): shape for shape in mi_scene.shapes()}
        for moving in objects:
            for name in moving.shapes:
                if name not in shapes or shapes[name].class_name() == "Instance":
                    raise SceneError(
                        f"{scene_file}: shape {name!r} of object {moving.name!r} is an instance or "
                        "inside a group; place the shape in the scene itself"
                    )
                self._movers.append((moving, self._mover(name, moving.name, scene_file)))

    def place(self, t_s: float) -> None:
        """Move all objects to where they are at a time on the camera's path, in seconds."""
        for moving, move in self._movers:
            move(moving.pose(t_s))
        self._parameters.update()

    def _mover(self, shape: str, of: str, scene_file: object) -> Callable[[Float64], None]:
        """Return a function that puts a shape where its object has the given pose."""
        import mitsuba as mi

        parameters = self._parameters
        to_world, positions = f"{shape}.to_world", f"{shape}.vertex_positions"
        if to_world in parameters:
            at_rest = np.array(parameters[to_world].matrix, np.float64).reshape(4, 4)

            def turn(T: Float64) -> None:
                parameters[to_world] = mi.ScalarTransform4f((T @ at_rest).tolist())

            return turn
        if positions not in parameters:
            raise SceneError(
                f"{scene_file}: shape {shape!r} of object {of!r} is of a kind that Mitsuba cannot "
                "move, expected a mesh, a sphere, a rectangle, a disk or a cylinder"
            )
        normals = f"{shape}.vertex_normals"
        vertices, directions = (
            np.array(parameters[key], np.float64).reshape(-1, 3) for key in (positions, normals)
        )
        kind = type(parameters[positions])

        def move_vertices(T: Float64) -> None:
            R = T[:3, :3]
            parameters[positions] = kind((vertices @ R.T + T[:3, 3]).astype(np.float32).ravel())
            if len(directions):  # or Mitsuba would make new ones
                parameters[normals] = kind((directions @ R.T).astype(np.float32).ravel())

        return move_vertices


@dataclass(frozen=True, eq=False, slots=True)
class Body:
    """A rigid part of a scene that moves, as rays meet it.

    `pose` returns T_world_object (..., 4, 4) at times (...), s, and is smooth between `knots_s`.
    `box_m` (2, 3) is the lower and upper corner of its shapes in its own coordinates.
    """

    name: str
    pose: Callable[[ArrayLike], Float64]
    knots_s: Float64
    caster: RayCaster
    box_m: Float64


def still_and_bodies(
    scene: Scene, mi_scene: Any, objects: Sequence[MovingObject]
) -> tuple[RayCaster, tuple[Body, ...]]:
    """Split a scene into what stands still and a body for each moving object.

    `mi_scene` has the objects where scene.xml puts them; it must not change.
    """
    if not objects:
        return RayCaster(mi_scene), ()
    shapes = {shape.id(): shape for shape in mi_scene.shapes()}
    of_objects = {name for moving in objects for name in moving.shapes}
    standing = [shape for name, shape in shapes.items() if name not in of_objects]
    if any(shape.class_name() == "Instance" for shape in standing):
        still = load_mi_scene(scene, without=of_objects)  # instances cannot be in another scene
    else:
        still = _scene_of(standing)
    bodies = []
    for moving in objects:
        part = _scene_of([shapes[name] for name in moving.shapes])
        box_m = np.array([np.ravel(part.bbox().min), np.ravel(part.bbox().max)], np.float64)
        bodies.append(Body(moving.name, moving.pose, moving.knots_s, RayCaster(part), box_m))
    return RayCaster(still), tuple(bodies)


def _scene_of(shapes: Sequence[Any]) -> Any:
    """Return a Mitsuba scene of shapes that another scene holds."""
    import mitsuba as mi

    names = [shape.id() for shape in shapes]
    scene = mi.load_dict({"type": "scene"} | {f"s{k}": shape for k, shape in enumerate(shapes)})
    for shape, name in zip(shapes, names, strict=True):
        shape.set_id(name)  # `load_dict` renamed it
    return scene
