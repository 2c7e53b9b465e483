"""A PLY mesh whose faces have vertices that are not there is refused: Mitsuba would crash."""

import numpy as np
import pytest

from eres_render import RenderError, SceneError, load_scene
from eres_render.rendering.backend import select_variant
from eres_render.rendering.load import load_mi_scene
from eres_render.scene.ply import check_faces
from light_scenes import CAMERA, write_scene

ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
TYPES = {"uchar": "u1", "short": "i2", "int": "i4", "float": "f4"}
CORNERS = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
FOUR_VERTICES = (
    "vertex",
    ["float x", "float y", "float z"],
    [[[number] for number in corner] for corner in CORNERS],
)
MESH = '<shape type="ply"><string name="filename" value="mesh.ply"/></shape>'


def write_elements(file, kind, *elements):
    """Write elements, each a name, its properties, and records of a list of numbers for each."""
    header, lines, data = f"ply\nformat {kind} 1.0\ncomment made by a test\n", "", b""
    for name, properties, records in elements:
        header += f"element {name} {len(records)}\n"
        header += "".join(f"property {one}\n" for one in properties)
        for record in records:
            for one, numbers in zip(properties, record, strict=True):
                *types, _ = one.removeprefix("list ").split()
                parts = [[len(numbers)], numbers] if len(types) == 2 else [numbers]
                for type_, part in zip(types, parts, strict=True):
                    lines += f"{' '.join(map(str, part))} "
                    data += np.array(part, ORDERS.get(kind, "<") + TYPES[type_]).tobytes()
            lines += "\n"
    header += "end_header\n"
    file.write_bytes(header.encode() + (lines.encode() if kind == "ascii" else data))
    return file


def write_ply(file, faces, kind="binary_little_endian", count_type="uchar"):
    """Write four vertices and faces, each a sequence of indices."""
    one_list = [f"list {count_type} int vertex_indices"], [[face] for face in faces]
    return write_elements(file, kind, FOUR_VERTICES, ("face", *one_list))


@pytest.mark.parametrize("count_type", ["uchar", "int"])
@pytest.mark.parametrize("kind", ["ascii", *ORDERS])
def test_faces_have_vertices_that_are_there(tmp_path, kind, count_type):
    """Promise: in every encoding, also where triangles and quads take turns."""
    file, how = tmp_path / "mesh.ply", (kind, count_type)
    for faces in ([(0, 1, 2), (0, 2, 3)], [(0, 1, 2, 3)], [(0, 1, 2), (0, 1, 2, 3), (0, 2, 3)], []):
        check_faces(write_ply(file, faces, *how))
    for faces in ([(0, 1, 4)], [(0, 1, 2), (0, 1, 2, 9_000_000)], [(0, 1, 2), (0, -1, 3)]):
        with pytest.raises(RenderError, match=r"mesh\.ply: a face refers to vertex \d+"):
            check_faces(write_ply(file, faces, *how))


def other_files(index):
    """Return the elements of files that Mitsuba loads, too, the last face of each with an index."""
    faces = [[(0, 1, 2)], [(0, 2, 3)], [(0, 1, index)]]
    indices = "list uchar int vertex_indices"
    with_color = [[face, [200], [0.5]] for (face,) in faces]
    color_first = [[[200], *face] for face in faces]
    edges = ("edge", ["int vertex1", "int vertex2"], [[[0], [1]], [[70_000_000], [2]]])
    strips = (
        "strip",
        ["short mark", "list int short ends"],
        [[[7], (0, 1, 900)], [[8], (2, 3, 901)]],
    )
    plain = "face", [indices], faces
    return {
        "a color behind": [FOUR_VERTICES, ("face", [indices, "uchar r", "float w"], with_color)],
        "a color before": [FOUR_VERTICES, ("face", ["uchar r", indices], color_first)],
        "an element behind": [FOUR_VERTICES, plain, edges],
        "an element between": [FOUR_VERTICES, edges, plain],
        "an element of lists": [strips, FOUR_VERTICES, plain],
        "faces first": [plain, FOUR_VERTICES],
        "another name": [FOUR_VERTICES, ("face", ["list uchar int vertex_index"], faces)],
        "short indices": [FOUR_VERTICES, ("face", ["list uchar short vertex_index"], faces)],
        "float indices": [FOUR_VERTICES, ("face", ["list uchar float vertex_index"], faces)],
    }


@pytest.mark.parametrize("layout", other_files(0))
@pytest.mark.parametrize("kind", ["ascii", *ORDERS])
def test_faces_are_found_among_other_elements_and_properties(tmp_path, kind, layout):
    """Promise: elements may be in any order, with properties and elements that nobody needs."""
    file = tmp_path / "mesh.ply"
    check_faces(write_elements(file, kind, *other_files(3)[layout]))
    for index, said in ((4, 4), (30_000, 30_000), (-1, 0xFFFFFFFF)):
        with pytest.raises(RenderError, match=rf"a face refers to vertex {said}, .* 4 vert"):
            check_faces(write_elements(file, kind, *other_files(index)[layout]))


def test_lines_of_a_text_file_are_as_mitsuba_reads_them(tmp_path):
    """Promise: an empty line in the header or in the data hides no face, nor does a comment in
    another encoding."""
    file = write_ply(tmp_path / "mesh.ply", [(0, 1, 2), (0, 1, 9)], "ascii")
    text = file.read_text()
    for now in (
        text.replace("element face", "\nelement face"),
        text.replace("3 0 1 9", "\n3 0\n1 9"),
    ):
        file.write_text(now.replace("made by", "créé par"), "latin-1")
        with pytest.raises(RenderError, match="a face refers to vertex 9"):
            check_faces(file)


def test_what_mitsuba_refuses_is_left_to_it(tmp_path):
    whole = write_ply(tmp_path / "mesh.ply", [(0, 1, 2), (0, 2, 3)]).read_bytes()
    select_variant()
    for kept in (0, 20, 100, len(whole) - 4):
        (tmp_path / "mesh.ply").write_bytes(whole[:kept])
        check_faces(tmp_path / "mesh.ply")
        with pytest.raises(SceneError, match=r"mine\.xml: could not be read as a Mitsuba scene"):
            load_mi_scene(load_scene(write_scene(tmp_path, CAMERA, MESH)))


def test_a_scene_with_such_a_mesh_is_refused(tmp_path):
    """Promise: an error that names the file; the process does not end by a signal."""
    write_ply(tmp_path / "mesh.ply", [(0, 1, 2), (0, 2, 9_000_000)])
    select_variant()
    with pytest.raises(RenderError, match=r"mesh\.ply: a face refers to vertex 9000000"):
        load_mi_scene(load_scene(write_scene(tmp_path, CAMERA, MESH)))
