"""duty_cycle."""
