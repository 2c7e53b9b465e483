"""Check that a camera path keeps clear of the surfaces of a scene."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from eres_render.errors import TrajectoryError
from eres_render.rendering.raycast import RayCaster

Float64 = NDArray[np.float64]

_DIRECTIONS = 512  # one every 9 degrees: 3 cm apart at 0.2 m
_MIN_PLACES, _MAX_PLACES = 100, 2000
_RAYS_AT_ONCE = 1 << 18
_CHORDS = 20_000  # that measure the length of a path
_KNOTS_AT_ONCE, _MAX_PIECES = 1 << 12, 256  # of the way from knot to knot


def check_clearance(
    place: Callable[[Float64], Float64],
    knots_s: Float64,
    duration_s: float,
    caster: RayCaster,
    min_clearance_m: float,
    where: str,
    *,
    alone: bool = False,
) -> None:
    """Refuse a path that crosses a surface, enters a solid, or comes too near to a surface.

    Rays start in 512 directions from places along the path, at most half the clearance apart (2000
    steps at most). Other rays follow the whole path along chords, within half the clearance.
    Objects thinner than the gaps between the rays are missed unless the path crosses them. `place`
    returns positions (N, 3) m at times (N,) s; it is smooth between `knots_s`. The camera may pass
    behind a single object (`alone`): it counts as inside if it sees backs in most of all
    directions, not only in most directions with a hit.
    """
    bad = _first_bad_place(place, duration_s, caster, min_clearance_m, alone)
    until_s = duration_s if bad is None else bad[0]
    within_s = knots_s[(knots_s > 0) & (knots_s < until_s)]
    t_s = np.union1d([0.0, until_s], within_s)
    bad = _first_crossing(place, t_s, caster, 0.5 * min_clearance_m) or bad
    if bad is not None:
        raise TrajectoryError(
            f"{where}: at t = {bad[0]:.3f} s the camera {bad[1]}, expected a path that keeps "
            f"min_clearance_m = {min_clearance_m:g} m from every surface"
        )


def _first_bad_place(
    place: Callable[[Float64], Float64],
    duration_s: float,
    caster: RayCaster,
    min_clearance_m: float,
    alone: bool,
) -> tuple[float, str] | None:
    """Return the time of the first place inside something or near it, and what is wrong there."""
    t_s = _evenly_along(place, duration_s, min_clearance_m)
    count, places = len(t_s), place(t_s)
    directions = _sphere(_DIRECTIONS)
    places_at_once = _RAYS_AT_ONCE // _DIRECTIONS
    for start in range(0, count, places_at_once):
        part = slice(start, start + places_at_once)
        n = len(places[part])
        hits = caster.cast(
            np.repeat(places[part], _DIRECTIONS, axis=0), np.tile(directions, (n, 1))
        )
        distance = hits.distance.reshape(n, -1)
        shape = hits.shape.reshape(n, -1)
        blind = hits.blind_side.reshape(n, -1)
        fewest = _DIRECTIONS if alone else 1
        inside = 2 * blind.sum(axis=1) > np.maximum(fewest, (shape >= 0).sum(axis=1))
        near = distance.min(axis=1) < min_clearance_m
        for k in np.flatnonzero(inside | near)[:1]:
            nearest = caster.shape_ids[shape[k, np.argmin(distance[k])]]
            if inside[k]:
                what = f"is inside a solid or behind a wall, shape {nearest!r}"
            else:
                what = f"comes within {distance[k].min():.3g} m of shape {nearest!r}"
            return float(t_s[start + k]), what
    return None


def _first_crossing(
    place: Callable[[Float64], Float64], t_s: Float64, caster: RayCaster, tolerance_m: float
) -> tuple[float, str] | None:
    """Return the first time at which a chord passes a surface, and what is wrong there."""
    for start in range(0, len(t_s) - 1, _KNOTS_AT_ONCE):  # paths may have a million knots
        part_s = _ends_of_chords(place, t_s[start : start + _KNOTS_AT_ONCE + 1], tolerance_m)
        places = place(part_s)
        steps = np.diff(places, axis=0)
        moves = np.flatnonzero(np.linalg.norm(steps, axis=1) > 0)
        ahead = caster.cast(places[moves], steps[moves])
        for k in np.flatnonzero(ahead.distance <= 1)[:1]:
            at_s = np.interp(moves[k] + ahead.distance[k], np.arange(len(part_s)), part_s)
            return float(at_s), f"passes through shape {caster.shape_ids[ahead.shape[k]]!r}"
    return None


def _ends_of_chords(
    place: Callable[[Float64], Float64], t_s: Float64, tolerance_m: float
) -> Float64:
    """Return times, those given among them, whose places have chords that follow the path."""
    places, spans_s = place(t_s), np.diff(t_s)
    third, later = (place(t_s[:-1] + share * spans_s) for share in (1 / 3, 2 / 3))
    # Of a cubic: second derivatives at both thirds, in units of the span, and then at both ends.
    bend = 9 * (places[:-1] - 2 * third + later), 9 * (third - 2 * later + places[1:])
    ends = 2 * bend[0] - bend[1], 2 * bend[1] - bend[0]
    most_m = np.max([np.linalg.norm(end, axis=1) for end in ends], axis=0)
    # A chord of a share of the span is off by an eighth of that, times the square of the share.
    pieces = np.ceil(np.sqrt(most_m / 8 / tolerance_m)).clip(1, _MAX_PIECES).astype(np.intp)
    k = np.repeat(np.arange(len(pieces)), pieces)
    piece = np.arange(len(k)) - (np.cumsum(pieces) - pieces)[k]
    return np.append(t_s[k] + piece / pieces[k] * spans_s[k], t_s[-1])


def _evenly_along(
    place: Callable[[Float64], Float64], duration_s: float, min_clearance_m: float
) -> Float64:
    """Return times from 0 to the duration at places evenly along the path, which may rest."""
    t_s = np.linspace(0.0, duration_s, _CHORDS + 1)
    chords_m = np.linalg.norm(np.diff(place(t_s), axis=0), axis=1)
    along_m = np.concatenate([[0.0], np.cumsum(chords_m)])
    steps = np.clip(np.ceil(2 * along_m[-1] / min_clearance_m), _MIN_PLACES, _MAX_PLACES)
    count = int(steps) + 1
    if along_m[-1] == 0:
        return np.linspace(0.0, duration_s, count)
    return np.interp(np.linspace(0.0, along_m[-1], count), along_m, t_s)


def _sphere(n: int) -> Float64:
    """Return (n, 3) unit vectors spread evenly over the sphere, on a Fibonacci spiral."""
    k = np.arange(n) + 0.5
    z = 1 - 2 * k / n
    angle = np.pi * (1 + 5**0.5) * k
    ring = np.sqrt(1 - z**2)
    return np.column_stack([ring * np.cos(angle), ring * np.sin(angle), z])
