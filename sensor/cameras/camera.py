"""`EventCamera`: its grid, pixels, light and bus, and where each value is from."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

from sensor.cameras.fields import in_file, keys_of
from sensor.errors import SensorError
from sensor.levels import DARK_SHARE
from sensor.model import Photoreceptor, SensorModel
from sensor.numbers import FINITE, POSITIVE, real

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from sensor.engine.arguments import Lit
    from sensor.engine.frames import FrameInput
    from sensor.events import Events
    from sensor.live import LiveCamera
    from sensor.readout import Readout

Kind = Literal["smallest", "nominal", "measured", "published", "given", "bound"]
KINDS: tuple[str, ...] = get_args(Kind)


class Source(NamedTuple):
    """Where a value is from.

    Parameters
    ----------
    text
        A publication, a file, or how it was measured.
    kind
        "smallest", the smallest contrast that was seen; "nominal"; "measured"; "published";
        "given" by a user; or "bound": only an interval is known, and nothing is simulated of it.
        Thresholds of different kinds are not comparable.
    interval
        (2,) its 95 % interval, in the unit of the camera's field; None if it is unknown.
    """

    text: str
    kind: Kind = "published"
    interval: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class EventCamera:
    """An event camera.

    Fields that are in `SensorModel` too have its meaning, default and source. What is not known has
    no entry in `sources`. Names end in their units; thresholds are in log units, sizes in px, the
    bus is in events/s. Lists, options and the schema of files show the first sentence of a field.

    Parameters
    ----------
    name
        Its name in tables and rows; "" for a plain sensor.
    title
        Name of the camera, in words.
    supplier
        Who sells it.
    year
        Year of release. 0 is unknown.
    interface
        Its connection to a computer.
    width
        Width. None, and so the height, for electronics alone.
    height
        Height.
    pitch_um
        Side of a pixel. None if it is unknown.
    fill_factor
        Light-sensitive share of a pixel's area. It acts as 1 if it is None, unknown.
    contrast_threshold
        Contrast threshold of ON events, and of OFF events that have none.
    contrast_threshold_off
        Contrast threshold of OFF events.
    threshold_mismatch
        Standard deviation of the thresholds between pixels; typically 0.03.
    photoreceptor
        Filter of its pixels; v2e's is one pole whose cutoff follows the light of each pixel.
    cutoff_hz
        Corner frequency of each pole of the photoreceptor; the paper has 200 for day and 50 for
        night. It holds in `illuminance_lux`, or in any light if that is None.
    cutoff_follows_light
        Whether a pixel's cutoff is proportional to its own light. White has the camera's.
        With the photoreceptor "v2e" it always is.
    illuminance_lux
        Light on the scene for which cutoff and shot noise hold.
    like
        Camera that lends its cutoff per lux. One that states no cutoff needs it.
    area_exponent
        Exponent of the photodiode's area in a cutoff that is lent, 0 to 1. 0 is for a capacitance
        that grows with the area, 1 for one that does not; pixels lie between.
    leak_hz
        Rate of ON events of a pixel in constant light; typically 0.1.
    shot_noise_hz
        Rate of noise events of a pixel in the dark.
    shot_noise_exponent
        Fall of the shot noise with the light.
    hot_pixel_fraction
        Share of hot pixels.
    hot_pixel_hz
        Rate of noise events of a hot pixel.
    refractory_s
        Dead time after an event.
    latency_s
        Delay from the crossing of a threshold to its event; on top of that of the photoreceptor.
    random_start
        Whether memories start at random levels, as in a camera that has been running.
    dark_share
        Dark level, as a share of white.
    warm_up
        Warm-up before a window, in time constants of the photoreceptor.
    bus_hz
        Capacity of the bus; "unlimited" for events that leave at once. That is inf here. `fifo` and
        this are `fifo_depth` and `max_rate_hz` of `Readout`.
    fifo
        Events that can wait for the bus; an event that finds the queue full is lost.
    row_overhead_s
        Time to open a row of pixels; the row that has waited longest is read next.
    sources
        Where values are from, by their keys in `sensor.cameras.camera.KEYS`.

    Raises
    ------
    SensorError
        A value is outside its range or of another kind; the text names it.

    Examples
    --------
    >>> from sensor import find_camera
    >>> camera = find_camera("davis346")
    >>> camera.width, camera.height, camera.pitch_um, camera.bus.max_rate_hz
    (346, 260, 18.5, 12000000.0)
    >>> camera.model(lux=67).cutoff_hz  # lent by a DVS128, 3 Hz per lux
    201.0
    """

    name: str = ""
    title: str = in_file("", part="name")
    supplier: str = in_file("", part="name")
    year: int = in_file(0, least=1900, most=2200, part="name")
    interface: str = in_file("", part="name")
    width: int | None = in_file(None, "px", part="grid")
    height: int | None = in_file(None, "px", part="grid")
    pitch_um: float | None = in_file(None, least=1e-3, most=1e6, part="grid")
    fill_factor: float | None = in_file(None, "share", part="grid")
    contrast_threshold: float = in_file(0.2, "log of ON", key="threshold")
    contrast_threshold_off: float | None = in_file(None, "log of OFF", key="threshold_off")
    threshold_mismatch: float = in_file(0.0, "log")
    photoreceptor: Photoreceptor = in_file("two_pole")
    cutoff_hz: float = in_file(math.inf)
    cutoff_follows_light: bool = in_file(False)
    illuminance_lux: float | None = in_file(None, least=POSITIVE, most=1e12)
    like: str = in_file("dvs128")
    area_exponent: float = in_file(0.0, most=1.0)
    leak_hz: float = in_file(0.0)
    shot_noise_hz: float = in_file(0.0)
    shot_noise_exponent: float = in_file(0.5)
    hot_pixel_fraction: float = in_file(0.0, "share", key="hot_pixels")
    hot_pixel_hz: float = in_file(100.0, key="hot_pixel_rate")
    refractory_s: float = in_file(0.0)
    latency_s: float = in_file(0.0)
    random_start: bool = in_file(False)
    dark_share: float = in_file(DARK_SHARE, "share", key="dark")
    warm_up: float = in_file(6.0, most=1e6)
    bus_hz: float = in_file(math.inf, "Mev/s", least=POSITIVE, part="bus")
    fifo: int = in_file(4096, "events", least=1, most=100_000_000, part="bus")
    row_overhead_s: float = in_file(0.0, most=1e9, part="bus")
    sources: Mapping[str, Source] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        for name, key in KEYS.items():
            value = getattr(self, key.field)
            if value is not None and value != key.default:
                object.__setattr__(self, key.field, key.checked(name, value))
        if (self.width is None) != (self.height is None):
            raise SensorError("width, height: give both or neither")

    @property
    def area_um2(self) -> float | None:
        """Area of a photodiode, um^2; None if pitch or fill factor is unknown."""
        return self.pitch_um**2 * self.fill_factor if self.pitch_um and self.fill_factor else None

    @property
    def borrows_cutoff(self) -> bool:
        """Whether its cutoff in a light is that of `like`, as it states none at an illuminance."""
        return math.isinf(self.cutoff_hz) or self.illuminance_lux is None

    @property
    def bus(self) -> Readout | None:
        """The bus on which events leave; None if they leave at once."""
        if self.bus_hz == math.inf:
            return None
        from sensor.readout import Readout  # here, as it loads Numba

        return Readout(
            max_rate_hz=self.bus_hz, fifo_depth=self.fifo, row_overhead_s=self.row_overhead_s
        )

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px; a camera without a grid raises `SensorError`."""
        if self.width is None or self.height is None:
            raise SensorError(f"{self.name or 'camera'}: needs width and height, and has neither")
        return self.width, self.height

    def states(self, key: str) -> bool:
        """Return whether the camera has a value of its own for a key, not only a bound."""
        if key in self.sources:
            return self.sources[key].kind != "bound"
        return bool(getattr(self, KEYS[key].field) != KEYS[key].default)

    def on(self, width: int, height: int) -> EventCamera:
        """Return these pixels on another grid.

        Parameters
        ----------
        width, height
            Size, px.

        Returns
        -------
        EventCamera
        """
        return replace(self, width=width, height=height)

    def with_threshold(self, contrast_threshold: float) -> EventCamera:
        """Return the camera with another threshold of ON events, log units, in which that of OFF
        events keeps its ratio to it."""
        off = self.contrast_threshold_off
        if off is not None:
            off = off * contrast_threshold / self.contrast_threshold
        return replace(self, contrast_threshold=contrast_threshold, contrast_threshold_off=off)

    def with_electronics(self, other: EventCamera) -> EventCamera:
        """Return this grid with the electronics and the bus of another camera.

        Parameters
        ----------
        other
            The other camera. What it does not know has its default; a bus that it does not know
            stays.

        Returns
        -------
        EventCamera
        """
        parts = {"electronics", "bus"} if other.states("bus") else {"electronics"}
        names = [name for name, key in KEYS.items() if key.part in parts]
        taken = {KEYS[name].field: getattr(other, KEYS[name].field) for name in names}
        sources = {name: source for name, source in self.sources.items() if name not in names}
        sources |= {name: source for name, source in other.sources.items() if name in names}
        return replace(self, **taken, sources=sources)

    def cutoff_at(self, lux: float) -> float:
        """Return the cutoff in a light on the scene.

        It is proportional to the light (Lichtsteiner, Posch and Delbruck 2008): from the camera's
        own pair of cutoff and illuminance, or else from that of the camera `like`, times the ratio
        of the photodiodes' areas to the power of `area_exponent`. An unknown area counts as equal.

        Parameters
        ----------
        lux
            Illuminance, lux.

        Returns
        -------
        float
            Hz.

        Raises
        ------
        SensorError
            The illuminance is not a positive number, or `like` has no cutoff.
        """
        cutoff_hz, at_lux = self._reference()
        return cutoff_hz * _checked_lux(lux) / at_lux

    def _reference(self) -> tuple[float, float]:
        """Return a cutoff in Hz, and the illuminance in lux for which it holds."""
        from sensor.cameras.files import find_camera  # which reads cameras

        lender = find_camera(self.like) if self.borrows_cutoff else self
        if lender.borrows_cutoff or lender.illuminance_lux is None:
            raise SensorError(
                f"like: the camera {self.like!r} does not have both a cutoff and an illuminance; "
                "choose another, such as 'dvs128'"
            )
        area, lenders = self.area_um2, lender.area_um2
        times = (area / lenders) ** self.area_exponent if area and lenders else 1.0
        return lender.cutoff_hz * times, lender.illuminance_lux

    def model(
        self,
        *,
        lux: float | None = None,
        cutoff_hz: float | None = None,
        white: float = 1.0,
        dark_white: float | None = None,
    ) -> SensorModel:
        """Return the pixels in one light, as the engine takes them.

        Parameters
        ----------
        lux
            Illuminance of the scene, lux, from which cutoff and shot noise follow; None for the
            camera's own cutoff.
        cutoff_hz
            Cutoff in place of that, Hz; inf for ideal pixels.
        white
            Radiance of white in the frames.
        dark_white
            Radiance of white for the dark level, where scenes of several brightnesses share one;
            None for `white`.

        Returns
        -------
        SensorModel

        Raises
        ------
        SensorError
            Both `lux` and `cutoff_hz` are given, the camera has no grid, a value is out of range,
            or a cutoff is to follow the light and there is none.

        Examples
        --------
        A tenth of the light gives a tenth of the cutoff:

        >>> from sensor import find_camera
        >>> find_camera("dvs128").model(lux=100).cutoff_hz
        300.0
        """
        if lux is not None and cutoff_hz is not None:
            raise SensorError("give lux or cutoff_hz, not both")
        _ = self.size  # a model needs one
        noise_hz = self.shot_noise_hz
        if lux is not None:
            noise_hz *= self._noise_factor(_checked_lux(lux))
        ideal = cutoff_hz == math.inf
        if cutoff_hz is None:
            cutoff_hz = self.cutoff_hz if lux is None else self.cutoff_at(lux)
        if self.cutoff_follows_light and math.isinf(cutoff_hz) and not ideal:
            raise SensorError(
                "cutoff_follows_light: needs a cutoff or an illuminance, and has neither"
            )
        follows = self.cutoff_follows_light or self.photoreceptor == "v2e"
        shared = {each.name for each in fields(SensorModel)} & {each.name for each in fields(self)}
        values: dict[str, Any] = {name: getattr(self, name) for name in shared} | {
            "fill_factor": self.fill_factor or 1.0,
            "cutoff_hz": cutoff_hz,
            "shot_noise_hz": noise_hz,
            "dark_level": self.dark_share * (white if dark_white is None else dark_white),
            "cutoff_reference": white if follows and cutoff_hz < math.inf else None,
        }
        return SensorModel(**values)

    def _noise_factor(self, lux: float) -> float:
        """Return how much more shot noise there is in a light than where the rate holds."""
        at_lux = self.illuminance_lux
        if at_lux is None:
            if math.isinf(self.cutoff_hz):
                return 1.0
            lent_hz, lent_lux = self._reference()
            at_lux = self.cutoff_hz * lent_lux / lent_hz  # where `like` has this cutoff
        try:
            return float((lux / at_lux) ** -self.shot_noise_exponent)
        except (OverflowError, ZeroDivisionError):
            return math.inf  # which SensorModel refuses

    def open(
        self,
        seed: int = 0,
        *,
        lux: float | None = None,
        cutoff_hz: float | None = None,
        white: float | None = None,
        threads: int | None = None,
        device: str = "cpu",
    ) -> LiveCamera:
        """Return the camera in a loop, with its bus: push a frame, get its events.

        Parameters
        ----------
        lux, cutoff_hz
            As for `model`.
        white
            Radiance of white; None for the 99.9th percentile of the first frame.
        seed, threads, device
            As for `sensor.LiveCamera`.

        Returns
        -------
        LiveCamera

        Raises
        ------
        SensorError
            As `model` and `sensor.LiveCamera`.

        Examples
        --------
        >>> import numpy as np
        >>> from sensor import find_camera
        >>> slope = np.linspace(0.0, 5.0, 260 * 346).reshape(260, 346)
        >>> with find_camera("davis346").open(lux=67) as live:
        ...     for k in range(3):
        ...         events = live.push(np.exp(0.01 * k * slope), t_s=0.01 * k)
        >>> live.model.cutoff_hz, live.report.dropped
        (201.0, 0)
        """
        from sensor.live import LiveCamera  # here, as it loads Numba

        lit = self._lit(lux, cutoff_hz, white)
        return LiveCamera(lit, seed=seed, readout=self.bus, threads=threads, device=device)

    def _lit(self, lux: float | None, cutoff_hz: float | None, white: float | None) -> Lit:
        """Return the pixels in a light, or a function of white if that is unknown."""
        if white is not None:
            return self.model(lux=lux, cutoff_hz=cutoff_hz, white=white)
        return lambda measured: self.model(lux=lux, cutoff_hz=cutoff_hz, white=measured)

    def stream(
        self,
        frames: FrameInput,
        t_s: ArrayLike,
        *,
        seed: int = 0,
        lux: float | None = None,
        cutoff_hz: float | None = None,
        white: float | None = None,
        threads: int | None = None,
        device: str = "cpu",
    ) -> Iterator[Events]:
        """Simulate the camera, with its bus, in parts.

        Parameters
        ----------
        frames, t_s
            As for `sensor.stream`.
        seed, lux, cutoff_hz, white, threads, device
            As for `open`.

        Yields
        ------
        Events
            Consecutive parts of the stream.

        Raises
        ------
        SensorError
            As `model` and `sensor.stream`.
        """
        from sensor.engine.bank import Bank
        from sensor.readout import read_out

        bank = Bank(frames, t_s, [self._lit(lux, cutoff_hz, white)], None, seed, threads, device)
        parts = (events for _, events in bank.run())
        yield from parts if self.bus is None else read_out(parts, self.bus)

    def simulate(self, frames: FrameInput, t_s: ArrayLike, **options: Any) -> Events:
        """Simulate the camera, with its bus.

        Parameters
        ----------
        frames, t_s, options
            As for `stream`.

        Returns
        -------
        Events

        Raises
        ------
        SensorError
            As `stream`.

        Examples
        --------
        >>> import numpy as np
        >>> from sensor import find_camera
        >>> slope = np.linspace(0.0, 0.5, 260 * 346).reshape(260, 346)
        >>> find_camera("davis346").simulate([np.ones((260, 346)), np.exp(slope)], [0, 0.1], lux=67)
        Events(123881 of 346x260 px, 28280..100019 us)
        """
        from sensor.events import concatenate

        return concatenate(list(self.stream(frames, t_s, **options)))

    def assumptions(
        self,
        *,
        lux: float | Sequence[float] | None = None,
        cutoff_hz: float | Sequence[float] | None = None,
        thresholds: Sequence[float] = (),
    ) -> str:
        """Return in words what a simulation of this camera assumes.

        Parameters
        ----------
        lux, cutoff_hz
            As for `model`, or several of them; inf for ideal pixels.
        thresholds
            Contrast thresholds in place of the camera's, log units.

        Returns
        -------
        str
            One line: grid, thresholds with their kind, light and cutoff, dark level, noise, bus.
        """
        grid = f"{self.width}x{self.height}" if self.width else ""
        pitch = f"{self.pitch_um:g} um" if self.pitch_um else ""
        fill = f"fill {100 * self.fill_factor:g} %" if self.fill_factor else ""
        parts = [", ".join(filter(None, (grid, pitch, fill)))]
        parts.append(f"C {_listed(thresholds)}" if thresholds else self._threshold_words())
        parts.append(self._light_words(lux, cutoff_hz))
        parts.append(f"dark {100 * self.dark_share:.3g} % of white")
        noise = {"leak": self.leak_hz, "shot noise": self.shot_noise_hz}
        rates = [f"{what} {hz:g} Hz" for what, hz in noise.items() if hz]
        unknown = [what for what in noise if not self.states(what.replace(" ", "_"))]
        parts.append(", ".join(rates) or "no noise")
        if unknown and self.name:
            parts[-1] += f" ({' and '.join(unknown)} unknown, 0)"
        for name in _ALSO_SAID:
            if (value := getattr(self, KEYS[name].field)) != KEYS[name].default:
                unit = next(iter(KEYS[name].units)).removesuffix("1")
                if unit == "s":
                    value, unit = 1e6 * value, "us"
                amount = "" if value is True else f"{value:g}"
                parts.append(" ".join(filter(None, (name.replace("_", " "), amount, unit))))
        bus = f"bus {self.bus_hz / 1e6:g} Mev/s"
        if math.isinf(self.bus_hz):
            bus = "no bus" if self.states("bus") or not self.name else "bus unknown, unlimited"
        return f"{self.name or 'plain'}: {'; '.join(filter(None, (*parts, bus)))}"

    def _threshold_words(self) -> str:
        on, off = self.contrast_threshold, self.contrast_threshold_off
        text = f"C {on:.3g}" if off in (None, on) else f"C +{on:.3g}/-{off:.3g}"
        source = self.sources.get("threshold")
        if source:
            return f"{text} ({source.kind})"
        return f"{text} (unknown, the default)" if self.name else text

    def _light_words(
        self, lux: float | Sequence[float] | None, cutoff_hz: float | Sequence[float] | None
    ) -> str:
        asked = lux if lux is not None else self.cutoff_hz if cutoff_hz is None else cutoff_hz
        every = [*asked] if isinstance(asked, Sequence) else [asked]
        finite = [value for value in every if math.isfinite(value)]
        parts = ["ideal pixels"] if len(finite) < len(every) else []
        if finite:
            at = "" if lux is None else f"{_listed(finite)} lux: "
            poles = {"two_pole": "", "one_pole": "one pole, ", "v2e": "v2e's pole, "}
            follows = "following the light of each pixel, " if self.cutoff_follows_light else ""
            cutoffs = finite if lux is None else map(self.cutoff_at, finite)
            text = f"{at}{poles[self.photoreceptor]}{follows}cutoff {_listed(cutoffs)} Hz"
            if lux is not None and self.borrows_cutoff:
                others = [replace(self, area_exponent=g) for g in {0, 1} - {self.area_exponent}]
                ends = ", ".join(
                    f"{_listed(map(other.cutoff_at, finite))} Hz at area^{other.area_exponent:g}"
                    for other in others
                )
                known = "area unknown" if self.area_um2 is None else ends
                text += f", lent by {self.like}, area^{self.area_exponent:g} ({known})"
            parts.append(text)
        return (", " if lux is None else "; ").join(parts)


# Keys that an answer names only if their values are not the defaults.
_ALSO_SAID = (
    *("threshold_mismatch", "hot_pixels", "hot_pixel_rate", "refractory", "latency"),
    "random_start",
)


def _listed(values: Iterable[float]) -> str:
    return ", ".join(f"{value:.3g}" for value in values)


KEYS = keys_of(EventCamera)
"""All keys of a camera's file, by name, in the order of files and lists."""

BUS_KEYS = [name for name, key in KEYS.items() if key.part == "bus"]
"""Keys that are about its bus."""


def _checked_lux(lux: float) -> float:
    return real("lux", lux, "a positive number", POSITIVE, FINITE)
