"""How well jgait knows when it is wrong: doubt and deviations of strides, on people, sets and faults left out."""

PARTS = ("strides_left_out",)
