"""Which rules earn their place: lines that no recording enters, and constants that no result depends on."""

PARTS = ("lines", "rules")
"""What no recording needs."""
