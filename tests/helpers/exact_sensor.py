"""One pixel in 200-bit arithmetic, with bisection only: the reference for the kernels.

It shares no code and no form of an equation with the package. It brackets and bisects every turn of
the voltage and every crossing; 60 decimal digits survive any cancellation.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import gmpy2
from gmpy2 import mpfr

gmpy2.get_context().precision = 200
TURN_BISECTIONS = 80  # of a dt up to 1e6: to 1e-18, where v2 is flat
CROSSING_BISECTIONS = 42  # of a frame interval: to 1e-12 of it


@dataclass(frozen=True)
class Pixel:
    """Parameters that determine the events of a pixel; `cutoff_reference` as in `SensorModel`, for
    v2e's filter if `v2e`."""

    C: float
    cutoff_hz: float = math.inf
    poles: int = 2
    leak_hz: float = 0.0
    dark: float = 0.0
    cutoff_reference: float | None = None
    v2e: bool = False
    C_off: float | None = None


@dataclass(frozen=True)
class ExactEvents:
    """Events of a pixel, and the distance of float64 from a different answer."""

    t_us: list[mpfr]
    p: list[int]
    margin: float
    """Least distance of a level from a turn of the voltage near it, log units."""
    worst_slowness_us: float
    """Longest time that the voltage takes for 1e-12 log units at a crossing."""


class Voltage:
    """v(t) of one frame interval, including the leak of the memory; t in seconds from its start."""

    def __init__(self, pixel, u0, u1, v1, v2, dt):
        self.dt, self.u0, self.s = dt, u0, (u1 - u0) / dt
        self.leak = mpfr(pixel.leak_hz) * mpfr(pixel.C)
        self.k = pixel.poles
        if math.isinf(pixel.cutoff_hz):
            self.a = None
            return
        self.a = 2 * gmpy2.const_pi() * mpfr(pixel.cutoff_hz)
        if pixel.v2e:
            gray = 255 * (gmpy2.exp((u0 + u1) / 2) - mpfr(pixel.dark)) / pixel.cutoff_reference
            self.a *= (gray + 20) / 275
        elif pixel.cutoff_reference is not None:
            self.a *= gmpy2.exp((u0 + u1) / 2) / mpfr(pixel.cutoff_reference)
        self.c1 = v1 - u0 + self.s / self.a
        self.c2 = v2 - u0 + self.k * self.s / self.a
        self.growth = self.c1 * self.a if self.k == 2 else mpfr(0)

    def filtered(self, t):
        """Return v without the leak."""
        if self.a is None:
            return self.u0 + self.s * t
        tail = (self.c2 + self.growth * t) * gmpy2.exp(-self.a * t)
        return self.u0 + self.s * (t - self.k / self.a) + tail

    def first_pole(self, t):
        if self.a is None:
            return self.u0 + self.s * t
        return self.u0 + self.s * (t - 1 / self.a) + self.c1 * gmpy2.exp(-self.a * t)

    def __call__(self, t):
        return self.filtered(t) + self.leak * t

    def slope(self, t):
        """Return dv/dt."""
        steady = self.s + self.leak
        if self.a is None:
            return steady
        now = self.growth - self.a * (self.c2 + self.growth * t)
        return steady + now * gmpy2.exp(-self.a * t)

    def turns(self):
        """Return the times within the interval at which the slope changes its sign."""
        if self.a is None:
            return []
        edges = [mpfr(0), self.dt]
        if self.growth != 0:
            flat = 2 / self.a - self.c2 / self.growth
            if 0 < flat < self.dt:
                edges.insert(1, flat)
        return [
            bisect(self.slope, low, high, TURN_BISECTIONS)
            for low, high in pairwise(edges)
            if self.slope(low) * self.slope(high) < 0
        ]


def bisect(f, low, high, steps, level=0):
    """Return the point where f, monotone between low and high, crosses a level."""
    rising = f(high) > level
    for _ in range(steps):
        middle = (low + high) / 2
        if (f(middle) > level) == rising:
            high = middle
        else:
            low = middle
    return (low + high) / 2


def exact_events(radiance, t_s, pixel):
    """Return the events of a pixel that sees the radiance at the times, both as exact numbers."""
    u = [gmpy2.log(mpfr(float(light)) + mpfr(pixel.dark)) for light in radiance]
    t_s = [mpfr(float(t)) for t in t_s]
    C = mpfr(pixel.C), mpfr(pixel.C if pixel.C_off is None else pixel.C_off)
    v1 = v2 = memory = u[0]
    events, margin, slowness_us = [], math.inf, 0.0
    direction = 0
    for (u0, u1), (t0, t1) in zip(pairwise(u), pairwise(t_s), strict=True):
        voltage = Voltage(pixel, u0, u1, v1, v2, t1 - t0)
        edges = [mpfr(0), *voltage.turns(), voltage.dt]
        for low, high in pairwise(edges):
            v_low, v_high = voltage(low), voltage(high)
            before, direction = direction, int(gmpy2.sign(v_high - v_low))
            if direction != before:
                margin = min(margin, distance_to_level(v_low, memory, C, events))
            p = int(gmpy2.sign(v_high - memory))
            step = C[0] if p > 0 else C[1]
            while abs(v_high - memory) >= step:
                level = memory + p * step
                if (v_low - level) * p >= 0:  # met at the interval's very start
                    t = low
                else:
                    t = bisect(voltage, low, high, CROSSING_BISECTIONS, level)
                slope = abs(float(voltage.slope(t)))
                slowness_us = max(slowness_us, 1e-12 / slope * 1e6 if slope else math.inf)
                events.append(((t0 + t) * 1_000_000, p))
                memory = level
        memory -= voltage.leak * voltage.dt
        v1, v2 = voltage.first_pole(voltage.dt), voltage.filtered(voltage.dt)
        if pixel.poles == 1:
            v1 = v2
    margin = min(margin, distance_to_level(v2, memory, C, events))
    return ExactEvents([t for t, _ in events], [p for _, p in events], margin, slowness_us)


def distance_to_level(v, memory, C, events):
    """Return the distance of v from the nearer of the two next levels, or from the last one."""
    levels = [memory - C[1], memory + C[0], *([memory] if events else [])]
    return float(min(abs(v - level) for level in levels))
