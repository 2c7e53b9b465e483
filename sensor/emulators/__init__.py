"""Other simulators as they run, to compare with: their steps and time stamps, not a pixel's."""

from sensor.emulators.v2e_steps import V2E_DEFAULTS, V2eFrame, V2ePixels, v2e

__all__ = ["V2E_DEFAULTS", "V2eFrame", "V2ePixels", "v2e"]
