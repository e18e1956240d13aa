"""Methods that fill the gaps of a duty-cycled gyroscope."""
