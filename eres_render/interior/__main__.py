"""Write the meshes of the room, and print the tables of textures for its scene.toml.

Run: python -m eres_render.interior scenes/room
"""

from __future__ import annotations

import sys
from pathlib import Path

from eres_render.interior.atlas import CELL_M
from eres_render.interior.pieces import PIECES


def main() -> None:
    folder = Path(sys.argv[1])
    for seed, (name, piece) in enumerate(PIECES.items()):
        atlas, k = piece.atlas(), piece.texels_per_cell
        (folder / f"{name}.ply").write_bytes(atlas.ply())
        print(f"[textures.{name}]")
        print(f'kind = "{name}"')
        print(f"size_px = {atlas.columns * k}")
        print(f"height_px = {atlas.rows * k}")
        print(f"texel_m = {CELL_M / k:.9g}")
        print(f"seed = {seed}\n")


if __name__ == "__main__":
    main()
