"""Tuning by gradient: recovery of known values, what the data do not determine, and other people."""

PARTS = ("noise", "lengths", "leave_one_out", "walking5m", "neura_sparse", "killed")
