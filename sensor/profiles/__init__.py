"""Profiles: the electronics of real sensors and of other simulators, each value with its source."""

from sensor.profiles.profile import Bound, Profile, Sourced
from sensor.profiles.reading import find_profile, profile_names, read_profile

__all__ = ["Bound", "Profile", "Sourced", "find_profile", "profile_names", "read_profile"]
