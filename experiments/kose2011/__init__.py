"""Heel strikes and walked distance from one sensor at the waist (Köse, Cereatti and Della Croce 2011)."""

PARTS = ("ofdri", "contacts", "distances", "mobgap", "tables", "speed")
