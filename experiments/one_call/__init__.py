"""All sensors in one call: mistakes in wearing, units and clocks that are named, combined stride lengths, live use.

People, walks and sensors of `mistakes` and `simulated` are drawn with keys that no threshold or weight was chosen on.
"""

PARTS = ("mistakes", "lengths", "live")
