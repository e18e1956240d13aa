"""Gait events: standing still, stances, initial and final contacts."""
