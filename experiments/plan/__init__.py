"""`jgait plan` and `jgait explain`: predicted errors beside real ones, and shares beside finite differences."""

PARTS = ("degraded", "explained")
