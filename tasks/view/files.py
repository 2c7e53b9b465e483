"""Write pictures to a file: MP4, GIF, WebP or PNG."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from tasks.errors import TaskError
from tasks.view.drawing import PALETTES, STRENGTHS, Picture

_ENCODERS = ("libx264", "libopenh264")  # for H.264, the best first
_PALETTE_PICTURES = 5  # first pictures, which determine the palette of a GIF
_GRAYS = (40, 120, 200)  # of light behind events, for which it has their colors
_WEBP_QUALITY = 60
_TICKS_HZ = {".gif": 100, ".webp": 1000}  # a picture lasts a whole number of ticks
_MIN_TICKS = {".gif": 2, ".webp": 11}  # browsers play shorter pictures ten times slower


def possible_fps(kind: str, fps: float) -> float:
    """Return the frame rate closest to a given one that a kind of file can have."""
    if kind not in _TICKS_HZ:
        return fps
    return _TICKS_HZ[kind] / max(_MIN_TICKS[kind], round(_TICKS_HZ[kind] / fps))


def write_mp4(path: Path, pictures: Iterator[Picture], fps: float) -> None:
    """Write an H.264 video of (H, W, 3) uint8 pictures, H and W even."""
    import av
    from av.video.reformatter import ColorRange, Colorspace

    encoder = next((name for name in _ENCODERS if name in av.codecs_available), None)
    if encoder is None:
        raise TaskError("PyAV's FFmpeg has no encoder for H.264; write a .webp or .gif")
    rate = Fraction(fps).limit_denominator(1000)
    first = next(pictures)
    options = {"crf": "23", "preset": "veryfast"} if encoder == "libx264" else {}
    # An absolute path, as FFmpeg takes what is before a colon for a protocol.
    with av.open(
        str(path.absolute()), "w", format="mp4", options={"movflags": "+faststart"}
    ) as container:
        stream: Any = container.add_stream(encoder, rate=rate, options=options)
        stream.height, stream.width = first.shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.codec_context.colorspace = Colorspace.ITU709
        stream.codec_context.color_range = ColorRange.MPEG
        for picture in chain([first], pictures):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
            coded = frame.reformat(
                format="yuv420p", dst_colorspace=Colorspace.ITU709, dst_color_range=ColorRange.MPEG
            )
            container.mux(stream.encode(coded))
        container.mux(stream.encode())


def write_gif(path: Path, pictures: Iterator[Picture], fps: float) -> None:
    """Write an animated GIF of (H, W, 3) uint8 pictures that repeats."""
    # One palette for all pictures, so that colors do not flicker.
    some = list(islice(pictures, _PALETTE_PICTURES))
    events = _event_colors()
    colors = Image.fromarray(np.concatenate(some)).quantize(256 - len(events))
    usual = (colors.getpalette() or [])[: 3 * (256 - len(events))]
    colors.putpalette([*usual, *events.ravel().tolist()])
    images = map(Image.fromarray, chain(some, pictures))
    coded = (image.quantize(palette=colors, dither=Image.Dither.NONE) for image in images)
    options = {"duration": round(1000 / fps), "loop": 0}
    next(coded).save(path, "GIF", save_all=True, append_images=coded, **options)


def _event_colors() -> Picture:
    """Return (N, 3) colors of events of both polarities, which the first pictures may lack."""
    colors = [
        strength * np.array(color) + (1 - strength) * np.array(ground)
        for palette in PALETTES.values()
        for color in (palette.brighter, palette.darker)
        for ground in (palette.ground, *((gray,) * 3 for gray in _GRAYS))
        for strength in STRENGTHS[1:]
    ]
    return np.round(colors).astype(np.uint8)


def write_webp(path: Path, pictures: Iterator[Picture], fps: float) -> None:
    """Write an animated WebP of (H, W, 3) uint8 pictures that repeats."""
    images = map(Image.fromarray, pictures)
    options = {"duration": round(1000 / fps), "loop": 0, "quality": _WEBP_QUALITY, "method": 4}
    next(images).save(path, "WEBP", save_all=True, append_images=images, **options)


def write_png(path: Path, pictures: Iterator[Picture], _: float) -> None:
    """Write the only picture, (H, W, 3) uint8."""
    Image.fromarray(next(pictures)).save(path, "PNG", optimize=True)


WRITERS: dict[str, Callable[[Path, Iterator[Picture], float], None]] = {
    ".mp4": write_mp4,
    ".gif": write_gif,
    ".webp": write_webp,
    ".png": write_png,
}
"""Writers of pictures, by extension."""
