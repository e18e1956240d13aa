"""jgait beside other libraries and beside hand-written C."""
