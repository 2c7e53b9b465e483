"""`SENSORS`: the event cameras of the paper's Table 1, by name."""

from __future__ import annotations

from dataclasses import dataclass

from sensor.errors import SensorError, nearest
from sensor.model import SensorModel


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorPreset:
    """A commercial camera: its pixels as a model, and data of its supplier.

    Parameters
    ----------
    supplier, camera
        Names as in Table 1 of the paper.
    year
        Year of release.
    interface
        "USB 2", "USB 3", or None if the table has no entry.
    max_bandwidth_mev_s
        Maximum event rate of its bus, millions per second, or None if the table has no entry.
    model
        Its resolution and fill factor. The electronics are ideal with the paper's threshold of 0.2;
        a profile (`sensor.profiles`) or `dataclasses.replace` changes them.
    pixel_pitch_um
        Side of a pixel, um, or None if it is unknown.
    fill_factor
        Light-sensitive share of its area, or None if it is unknown. Like the pitch from table 1 of
        Gallego et al., Event-based vision: a survey (IEEE TPAMI 2022); the DVS128's from
        Lichtsteiner, Posch and Delbruck (2008).

    Examples
    --------
    >>> from sensor.presets import SENSORS
    >>> [name for name, one in SENSORS.items() if one.model.width >= 1280]
    ['gen4-cd', 'dvs-gen4', 'celex-v']
    """

    supplier: str
    camera: str
    year: int
    interface: str | None
    max_bandwidth_mev_s: float | None
    model: SensorModel
    pixel_pitch_um: float | None = None
    fill_factor: float | None = None


def _preset(
    supplier: str,
    camera: str,
    year: int,
    size: tuple[int, int],
    interface: str | None,
    max_bandwidth_mev_s: float | None,
    pixel_pitch_um: float,
    fill_factor: float | None,
) -> SensorPreset:
    return SensorPreset(
        supplier=supplier,
        camera=camera,
        year=year,
        interface=interface,
        max_bandwidth_mev_s=max_bandwidth_mev_s,
        model=SensorModel(width=size[0], height=size[1], fill_factor=fill_factor or 1.0),
        pixel_pitch_um=pixel_pitch_um,
        fill_factor=fill_factor,
    )


SENSORS: dict[str, SensorPreset] = {
    "dvs128": _preset("iniVation", "DVS128", 2008, (128, 128), "USB 2", 1, 40, 0.094),
    "davis240": _preset("iniVation", "DAVIS240", 2014, (240, 180), "USB 2", 12, 18.5, 0.22),
    "davis346": _preset("iniVation", "DAVIS346", 2017, (346, 260), "USB 3", 12, 18.5, 0.22),
    "dvxplorer": _preset("iniVation", "DVXPlorer", 2020, (640, 480), "USB 3", 165, 9, None),
    "atis": _preset("Prophesee", "ATIS", 2011, (304, 240), None, None, 30, 0.2),
    "gen3-cd": _preset("Prophesee", "Gen3 CD", 2017, (640, 480), "USB 3", 66, 15, 0.25),
    "gen3-atis": _preset("Prophesee", "Gen3 ATIS", 2017, (480, 360), "USB 3", 66, 20, 0.2),
    "gen4-cd": _preset("Prophesee", "Gen4 CD", 2020, (1280, 720), "USB 3", 1066, 4.86, 0.77),
    "dvs-gen2": _preset("Samsung", "DVS-Gen2", 2017, (640, 480), "USB 2", 300, 9, 0.11),
    "dvs-gen3": _preset("Samsung", "DVS-Gen3", 2018, (640, 480), "USB 3", 600, 9, 0.12),
    "dvs-gen4": _preset("Samsung", "DVS-Gen4", 2020, (1280, 960), "USB 3", 1200, 4.95, 0.22),
    "celex-iv": _preset("CelePixel", "CeleX-IV", 2017, (768, 640), None, 200, 18, 0.085),
    "celex-v": _preset("CelePixel", "CeleX-V", 2019, (1280, 800), None, 140, 9.8, 0.08),
    "rhino-3": _preset("Insightness", "Rhino 3", 2018, (320, 262), "USB 2", 50, 13, 0.22),
}


def find_sensor(name: str) -> SensorPreset:
    """Return the preset with this name.

    Raises
    ------
    SensorError
        The name is unknown; the text suggests a similar name or lists all.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from sensor.presets import find_sensor
    >>> preset = find_sensor("davis346")
    >>> preset.model.width, preset.model.height, preset.max_bandwidth_mev_s
    (346, 260, 12)
    >>> preset.pixel_pitch_um, preset.model.fill_factor
    (18.5, 0.22)
    >>> replace(preset.model, cutoff_hz=200.0).cutoff_hz  # a real camera has no ideal pixels
    200.0
    >>> find_sensor("davis364")
    Traceback (most recent call last):
    sensor.errors.SensorError: sensor: found 'davis364'; did you mean 'davis346'?
    """
    if name in SENSORS:
        return SENSORS[name]
    raise SensorError(f"sensor: found {name!r}; {nearest(name, SENSORS)}")
