"""Profiles: the electronics of real sensors and of other simulators, each value with its source."""

from sensor.profiles.profile import Profile, Sourced
from sensor.profiles.reading import find_profile, profile_names, read_profile

__all__ = ["Profile", "Sourced", "find_profile", "profile_names", "read_profile"]
