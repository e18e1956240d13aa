"""Sensors that are switched off part of the time: energy, schedules, and recordings with filled gaps."""
