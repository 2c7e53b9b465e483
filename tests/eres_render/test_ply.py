"""A PLY mesh whose faces have vertices that are not there is refused: Mitsuba would crash."""

import numpy as np
import pytest

from eres_render import RenderError, SceneError, load_scene
from eres_render.rendering.backend import select_variant
from eres_render.rendering.load import load_mi_scene
from eres_render.scene.ply import check_faces
from light_scenes import CAMERA, write_scene

VERTICES = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
MESH = '<shape type="ply"><string name="filename" value="mesh.ply"/></shape>'


def write_ply(file, faces, kind="binary_little_endian", count_type="uchar"):
    """Write four vertices and faces, each a sequence of indices."""
    header = (
        f"ply\nformat {kind} 1.0\ncomment made by a test\nelement vertex 4\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {len(faces)}\n"
        f"property list {count_type} int vertex_indices\nend_header\n"
    )
    if kind == "ascii":
        lines = [*VERTICES.tolist(), *([len(face), *face] for face in faces)]
        data = "".join(f"{' '.join(map(str, line))}\n" for line in lines).encode()
    else:
        order = "<" if kind == "binary_little_endian" else ">"
        count = f"{order}{'u1' if count_type == 'uchar' else 'i4'}"
        data = VERTICES.astype(f"{order}f4").tobytes() + b"".join(
            np.array([len(face)], count).tobytes() + np.array(face, f"{order}i4").tobytes()
            for face in faces
        )
    file.write_bytes(header.encode() + data)
    return file


@pytest.mark.parametrize("count_type", ["uchar", "int"])
@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_faces_have_vertices_that_are_there(tmp_path, kind, count_type):
    """Promise: in every encoding, also where triangles and quads take turns."""
    file, how = tmp_path / "mesh.ply", (kind, count_type)
    for faces in ([(0, 1, 2), (0, 2, 3)], [(0, 1, 2, 3)], [(0, 1, 2), (0, 1, 2, 3), (0, 2, 3)], []):
        check_faces(write_ply(file, faces, *how))
    for faces in ([(0, 1, 4)], [(0, 1, 2), (0, 1, 2, 9_000_000)], [(0, 1, 2), (0, -1, 3)]):
        with pytest.raises(RenderError, match=r"mesh\.ply: found a face of vertex \d+, expected 0"):
            check_faces(write_ply(file, faces, *how))


def test_what_mitsuba_refuses_is_left_to_it(tmp_path):
    whole = write_ply(tmp_path / "mesh.ply", [(0, 1, 2), (0, 2, 3)]).read_bytes()
    select_variant()
    for kept in (0, 20, 100, len(whole) - 4):
        (tmp_path / "mesh.ply").write_bytes(whole[:kept])
        check_faces(tmp_path / "mesh.ply")
        with pytest.raises(SceneError, match=r"mine\.xml: Mitsuba refuses it"):
            load_mi_scene(load_scene(write_scene(tmp_path, CAMERA, MESH)))


def test_a_scene_with_such_a_mesh_is_refused(tmp_path):
    """Promise: an error that names the file; the process does not end by a signal."""
    write_ply(tmp_path / "mesh.ply", [(0, 1, 2), (0, 2, 9_000_000)])
    select_variant()
    with pytest.raises(RenderError, match=r"mesh\.ply: found a face of vertex 9000000, expected 0"):
        load_mi_scene(load_scene(write_scene(tmp_path, CAMERA, MESH)))
