"""The room's pieces by name: their charts, and how finely each is painted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from eres_render.errors import SceneError
from eres_render.interior import decor, furniture, shell
from eres_render.interior.atlas import CELL_M, Atlas, layout
from eres_render.interior.uv_charts import Chart
from eres_render.textures.fractal_noise import Float32


@dataclass(frozen=True, slots=True)
class Piece:
    """How a piece is made."""

    charts: Callable[[], list[Chart]]
    texels_per_cell: int
    columns: int = 1

    def atlas(self) -> Atlas:
        """Return its charts with their places on the texture."""
        return layout(self.charts(), self.columns)


PIECES = {
    "floor": Piece(shell.floor, 12),
    "ceiling": Piece(shell.ceiling, 8),
    "beams": Piece(shell.beams, 8),
    "walls": Piece(shell.walls, 10),
    "joinery": Piece(shell.joinery, 8),
    "table": Piece(furniture.table, 16, 84),
    "coffee_table": Piece(furniture.coffee_table, 20, 54),
    "chairs": Piece(furniture.chairs, 16, 128),
    "sofa": Piece(furniture.sofa, 16, 128),
    "rug": Piece(furniture.rug, 16),
    "bookcase": Piece(furniture.bookcase, 12, 128),
    "books": Piece(furniture.books, 16, 160),
    "sideboard": Piece(furniture.sideboard, 14, 96),
    "stool": Piece(furniture.stool, 16, 64),
    "pictures": Piece(decor.pictures, 16, 128),
    "curtains": Piece(decor.curtains, 10, 200),
    "floor_lamp": Piece(decor.floor_lamp, 14, 80),
    "plant": Piece(decor.plant, 16, 128),
    "lamps": Piece(decor.lamps, 10, 64),
    "things": Piece(decor.things, 20, 128),
}


def paint(name: str, width_px: int, height_px: int, texel_m: float, seed: int) -> Float32:
    """Return the texture of a piece."""
    piece = PIECES[name]
    atlas = piece.atlas()
    k = piece.texels_per_cell
    if (width_px, height_px) != (atlas.columns * k, atlas.rows * k):
        raise SceneError(
            f"texture {name}: found size_px {width_px} and height_px {height_px}, expected "
            f"{atlas.columns * k} and {atlas.rows * k}, as in its atlas"
        )
    if abs(texel_m * k - CELL_M) > 1e-9:
        raise SceneError(f"texture {name}: found texel_m {texel_m}, expected {CELL_M / k:.9g}")
    return atlas.paint(k, seed)
