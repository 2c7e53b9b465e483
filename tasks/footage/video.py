"""Videos, read by FFmpeg's libraries through PyAV."""

from __future__ import annotations

import logging
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eres_render.errors import reading
from tasks.errors import TaskError

_log = logging.getLogger(__name__)

_RIGHT_ANGLE = 1e-3  # largest deviation from a right angle, radians
_LONGER, _SOUND_S = 3, 0.1  # a last frame that is no sign of a missing end: intervals, and seconds
_COARSE = 0.05  # of the time between frames: ticks that are longer cause a warning
_HIGH_DEFINITION = 720  # rows from which untagged video is taken to have the matrix of BT.709


@contextmanager
def _open(path: Path) -> Iterator[tuple[Any, Any]]:
    """Open a video and give its container and stream; errors name the file."""
    import av  # here: it loads FFmpeg's libraries
    from av.sidedata.sidedata import Type

    Type._missing_ = classmethod(_unnamed)  # type: ignore[method-assign, assignment]
    with (
        reading(path, "a video", TaskError),
        # An absolute path, as FFmpeg takes what is before a colon for a protocol.
        av.open(str(path.absolute()), metadata_errors="replace") as container,
    ):
        if not container.streams.video:
            raise TaskError(f"{path}: contains no video")
        stream = container.streams.video[0]
        if stream.codec_context is None or stream.codec_context.format is None:
            raise TaskError(f"{path}: this FFmpeg cannot decode its codec or pixel format")
        stream.thread_type = "AUTO"
        yield container, stream


def times_ns(path: Path, fps: float | None) -> list[int]:
    """Return the time at which each frame of a video is shown, nanoseconds; by `fps` if given."""
    with _open(path) as (container, stream):
        times = [
            packet.pts
            for packet in container.demux(stream)
            if packet.size and not packet.is_discard and _is_shown(packet, stream.codec.name)
        ]
        tick_s = Fraction(stream.time_base or 0)
        rates = [stream.average_rate, stream.base_rate, stream.guessed_rate]
        stated_us, start = container.duration, stream.start_time or 0
    timed = tick_s > 0 and None not in times
    if timed:
        times = _from_first_shown(sorted(times), path)
    if len(times) < 2:
        raise TaskError(f"{path}: frames: found {len(times)}, expected at least 2")
    if timed and stated_us is not None:
        _warn_if_short([(t - start) * tick_s for t in times], stated_us / 1e6, path)
    if fps is not None:
        return [round(k * 1e9 / fps) for k in range(len(times))]
    if not timed or len(set(times)) < len(times):
        raise TaskError(f"{path}: some frames have no time, or the same time; give --fps")
    return _unrounded_ns(times, tick_s, [Fraction(rate) for rate in rates if rate], path)


def _from_first_shown(times: list[int], path: Path) -> list[int]:
    """Return the times from the first frame that the decoder shows.

    After a cut, at a keyframe of an open group of pictures or within a gradual refresh, earlier
    frames need frames that are no longer there.
    """
    with _open(path) as (container, stream):
        first = next(container.decode(stream), None)
    if first is None or first.pts is None:
        return times
    skipped = bisect_left(times, first.pts)
    if skipped:
        message = "%s: the first %d frames are skipped, as they need frames from before a cut"
        _log.info(message, path, skipped)
    return times[skipped:]


def _unrounded_ns(
    times: Sequence[int], tick_s: Fraction, rates: Sequence[Fraction], path: Path
) -> list[int]:
    """Return times in nanoseconds: of an even grid, if that explains them, or as they are.

    Containers round to ticks: Matroska and Flash to 1 ms, GIF to 10 ms. Rounded times of a rate are
    less than a tick from its grid, all the same way; a missing frame is no rounding.
    """
    stored = [round(t * tick_s * 10**9) for t in times]
    if not rates:
        return stored
    since = np.array([t - times[0] for t in times], float)
    count = np.arange(len(times))
    apart, rate = min((float(np.ptp(since - count / float(hz * tick_s))), hz) for hz in rates)
    tick_ms = float(1e3 * tick_s)
    if apart < 1 - 1e-6:
        start_s = times[0] * tick_s
        even = [round((start_s + k / rate) * 10**9) for k in range(len(times))]
        if even != stored:
            _log.info(
                "%s: the stored times are rounded to %.3g ms, and are replaced by even times at "
                "%.6g frames per second",
                path,
                tick_ms,
                float(rate),
            )
        return even
    share = 1 / float(np.median(np.diff(since)))
    if share > _COARSE and rates[0] * tick_s != 1:  # AVI counts frames
        _log.warning(
            "%s: times are rounded to %.3g ms, %.0f %% of the time between frames, and fit no "
            "constant rate; events are up to %.3g ms off. A container with finer times, such as "
            "MP4, avoids that",
            path,
            tick_ms,
            100 * share,
            tick_ms / 2,
        )
    return stored


def _warn_if_short(times_s: Sequence[Fraction], stated_s: float, path: Path) -> None:
    """Warn of a video whose end is missing: Matroska and Flash state their length at the start.

    The last frame may be shown for longer than others, and sound may go on for longer.
    """
    longest_s = max(float(after - before) for before, after in pairwise(times_s))
    last_s = float(times_s[-1])
    if stated_s - last_s > _LONGER * longest_s + _SOUND_S:
        message = "%s: the frames end at %.3g s, but the file states %.3g s: its end may be missing"
        _log.warning(message, path, last_s, stated_s)


# Transfer characteristics of H.273, Table 3; those that are not named are BT.709's, or close to it.
_CURVES = {4: "gamma:2.2", 5: "gamma:2.8", 8: "linear", 13: "srgb"}
_OTHER_CURVES = {9: "a logarithm", 10: "a logarithm", 16: "PQ", 17: "SMPTE ST 428-1", 18: "HLG"}


def tagged_encoding(path: Path, encoding: str | None) -> str:
    """Return the transfer function in a video's tags; warn of what is left out.

    Tags of other curves, such as PQ, are an error unless the user gave an `encoding`.
    """
    with _open(path) as (_, stream):
        codec = stream.codec_context
        curve = int(codec.color_trc)
        transparent = any(component.is_alpha for component in codec.format.components)
        ratio = stream.sample_aspect_ratio
    if curve in _OTHER_CURVES and encoding is None:
        name = _OTHER_CURVES[curve]
        raise TaskError(f"{path}: is encoded with {name}; convert it to BT.709 or give --encoding")
    if transparent:
        _log.warning("%s: transparency is ignored; transparent pixels become visible", path)
    if ratio and ratio != 1:
        _log.warning("%s: pixels %s times as wide as high are treated as square", path, ratio)
    return _CURVES.get(curve, "rec709")


def _is_shown(packet: Any, codec: str) -> bool:
    """Return whether a packet has a picture to show: VP8's reference frames may be for others.

    They have a packet of their own, and bit 4 of its first byte is 0 (RFC 6386, Section 9.1).
    """
    return codec != "vp8" or bool(bytes(packet)[0] & 0x10)


def read_frames(path: Path, count: int) -> Iterator[NDArray[np.generic]]:
    """Decode the frames of a video one after another, rotated and mirrored by its display matrix.

    They are (H, W) for gray video, else (H, W, 3) red, green, blue; uint8, or uint16 above 8 bits.
    """
    k, size = 0, None
    with _open(path) as (container, stream):
        for k, frame in enumerate(container.decode(stream), start=1):
            matrix = frame.side_data.get("DISPLAYMATRIX")
            numbers = _numbers(frame)
            if matrix is not None:
                numbers = _turned(numbers, matrix, path)
            height, width = numbers.shape[:2]
            size = size or (width, height)
            if (width, height) != size:
                raise TaskError(f"{path}: frame {k} has {width}x{height} px, unlike frame 1")
            yield numbers
    if k != count:
        raise TaskError(f"{path}: decoded {k} frames, expected {count}; the video is damaged")


def _unnamed(kinds: type[Any], value: object) -> Any:
    """Return a kind of side data that PyAV has no name for, such as Exif, and would raise for."""
    kind = object.__new__(kinds)
    kind._name_, kind._value_ = f"UNNAMED_{value}", value
    return kind


def _numbers(frame: Any) -> NDArray[np.generic]:
    """Return the pixel values of a frame in full range, using the color matrix in its tags."""
    from av.video.reformatter import ColorRange, Colorspace, Interpolation

    components = frame.format.components
    deep = max(component.bits for component in components) > 8
    gray = len(components) == 1 and not frame.format.has_palette and not frame.format.is_bayer
    target = ("gray16le" if deep else "gray") if gray else "rgb48le" if deep else "rgb24"
    untagged = Colorspace.ITU709 if frame.height >= _HIGH_DEFINITION else Colorspace.ITU601
    tags = {space.value: space for space in Colorspace}
    tags |= {6: Colorspace.ITU601, 10: Colorspace.BT2020}  # in tags alone, not in swscale
    numbers: NDArray[np.generic] = frame.to_ndarray(
        format=target,
        src_colorspace=tags.get(frame.colorspace, untagged),
        dst_colorspace=Colorspace.ITU709,
        src_color_range=frame.color_range or ColorRange.MPEG,
        dst_color_range=ColorRange.JPEG,
        # Without full chroma, a coarse table makes subsampled video up to 2 of 255 too dark.
        interpolation=Interpolation.BILINEAR
        | Interpolation.ACCURATE_RND
        | Interpolation.FULL_CHR_H_INT,
    )
    if gray and frame.color_range == ColorRange.MPEG:  # which swscale leaves as it is
        highest = 65535 if deep else 255
        black, white = (code * (highest + 1) / 256 for code in (16, 235))
        full = np.clip((numbers.astype(np.float64) - black) / (white - black), 0.0, 1.0)
        return np.round(highest * full).astype(numbers.dtype)
    return numbers


def _turned(numbers: NDArray[np.generic], matrix: Any, path: Path) -> NDArray[np.generic]:
    """Return the pixel values of a frame, rotated and mirrored by its display matrix.

    The matrix is 9 int32, a b u c d v x y w: column p and row q are shown at column a p + c q and
    row b p + d q (QuickTime File Format, "Matrices").
    """
    a, b, _, c, d = np.frombuffer(bytes(matrix), np.int32)[:5].tolist()
    upright, sideways = abs(a) + abs(d), abs(b) + abs(c)
    if min(upright, sideways) > _RIGHT_ANGLE * max(upright, sideways):
        degrees = np.degrees(np.arctan2(b, a))
        raise TaskError(f"{path}: is rotated by {degrees:.3g} degrees, not by a multiple of 90")
    columns, rows = (c, b) if sideways > upright else (a, d)
    if sideways > upright:
        numbers = numbers.swapaxes(0, 1)
    return np.ascontiguousarray(numbers[:: -1 if rows < 0 else 1, :: -1 if columns < 0 else 1])
