"""Recipes for textures in scene.toml, and the cached files made from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from eres_render.errors import RenderError, SceneError
from eres_render.interior.pieces import PIECES, paint
from eres_render.storage.cache import cache_dir
from eres_render.storage.digest import digest
from eres_render.storage.exr import check_readable, to_half, write_channels
from eres_render.textures.carpet import bokhara
from eres_render.textures.forest import forest
from eres_render.textures.fractal_noise import Float32
from eres_render.textures.nature import garden_view
from eres_render.textures.pebble_print import pebble_print
from eres_render.textures.split_rocks import split_rocks
from eres_render.textures.stones import pebble_bed


@dataclass(frozen=True, slots=True)
class Texture:
    """A kind of texture; `version` rises with every change that alters a texel.

    `make` takes width_px, height_px, texel_m and seed; it returns (height_px, width_px).
    """

    version: int
    make: Callable[[int, int, float, int], Float32]


TEXTURES: dict[str, Texture] = {
    "carpet": Texture(4, bokhara),
    "stone_bed": Texture(1, pebble_bed),
    "stones": Texture(3, pebble_print),
    "garden_view": Texture(2, garden_view),
    "forest": Texture(1, forest),
    "split_rocks": Texture(1, split_rocks),
    **{name: Texture(1, partial(paint, name)) for name in PIECES},
}


@dataclass(frozen=True, slots=True)
class TextureRecipe:
    """How to make a texture of `TEXTURES`, `size_px` texels wide and, by default, as many high.

    `texel_m` is the size of a texel of what it shows, which on a print is larger than the print.
    """

    kind: str
    size_px: int
    texel_m: float
    seed: int
    height_px: int | None = None

    def __post_init__(self) -> None:
        if self.kind not in TEXTURES:
            raise SceneError(f"texture kind: found {self.kind!r}, expected one of {list(TEXTURES)}")
        if min(self.shape) < 1 or not self.texel_m > 0:
            raise SceneError(
                f"texture {self.kind}: found size_px {self.size_px}, height_px {self.height_px} "
                f"and texel_m {self.texel_m}, expected positive numbers"
            )

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return (self.size_px if self.height_px is None else self.height_px, self.size_px)

    @property
    def digest(self) -> str:
        """Digest of the recipe and of the version of the code that makes the texture."""
        return digest([TEXTURES[self.kind].version, self])

    def make(self) -> Float32:
        """Return the texels, `shape` float32: reflectance, or radiance of an emitter."""
        height_px, width_px = self.shape
        return TEXTURES[self.kind].make(width_px, height_px, self.texel_m, self.seed)

    def file(self) -> Path:
        """Return an uncompressed EXR file of the texels (half float, Y), made unless cached."""
        path = cache_dir() / "textures" / f"{self.kind}-{self.digest[:16]}.exr"
        try:
            check_readable(path)
        except (FileNotFoundError, RenderError):  # damaged, as by a power failure
            write_channels(path, {"Y": to_half(self.make(), path)}, compression="none")
        return path
