"""Sensors' events through methods to scores, for studies and for single sequences."""
