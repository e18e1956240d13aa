"""Joint centres from the markers of a motion capture."""

from collections.abc import Mapping, Sequence

import numpy as np

from experiments.common.replay.body import JointCentres, LegCentres, PelvisMarkers
from jgait.io.formats.c3d import Capture
from jgait.types import SIDES, RecordingError

MIDDLE = ("hip", "knee", "ankle")
NAMES: dict[str, tuple[tuple[str, ...], ...]] = {
    "hip": (("{}HJC",), ("{}FEP",)),
    "knee": (("{}KJC",), ("{}FEO",), ("{}KNE", "{}KNM")),
    "ankle": (("{}AJC",), ("{}TIO",), ("{}ANK", "{}MED")),
    "heel": (("{}HEE",), ("{}HEEL",)),
    "toe": (("{}TOE",),),
    "pelvis_front": (("{}ASI",), ("{}ASIS",)),
    "pelvis_back": (("{}PSI",), ("{}PSIS",)),
}
"""Point → markers of which it is the mean, `{}` L or R, the first that are all there: the Conventional Gait Model's
joint centres (HJC, …), Plug-in Gait's bones (femur proximal and origin, tibia origin), or markers on both sides."""


def joint_centres(capture: Capture, names: Mapping[str, str | Sequence[str]] | None = None) -> JointCentres:
    """Joint centres and foot markers of a capture, as `replay` takes them.

    Args:
        capture: with z up.
        names: 'hip_right', 'knee_left', 'ankle_…', 'heel_…', 'toe_…', 'pelvis_front_…', 'pelvis_back_…' → the marker,
            or the markers whose mean it is (both sides of a knee); None, and for what is not named: `NAMES`. A marker
            on one side of a joint is not its centre and never taken for it unless named.

    Returns:
        The legs of which hip, knee and ankle are there, heel and toe where both are; the pelvis where all four are.

    Raises:
        RecordingError: if the axis that points up is not known, or a named marker or every leg is missing.
    """
    if capture.up is None:
        raise RecordingError(f"{capture.name}: which axis points up is not known; give up to read_c3d")
    chosen = dict(names or {})
    points = {f"{point}_{side}" for point in NAMES for side in SIDES}
    unknown = [point for point in chosen if point not in points]
    if unknown:
        raise RecordingError(f"there is no point {unknown[0]!r}; expected some of {', '.join(sorted(points))}")
    places = {point: _point(capture, point, chosen) for point in points}
    legs: dict[str, LegCentres | None] = {}
    for side in SIDES:
        joints = [places[f"{point}_{side}"] for point in MIDDLE]
        foot = [places[f"{point}_{side}"] for point in ("heel", "toe")]
        whole = all(joint is not None for joint in joints)
        legs[side] = LegCentres(*joints, *(foot if all(f is not None for f in foot) else ())) if whole else None
    if legs["right"] is None and legs["left"] is None:
        expected = ", ".join(_called(point) for point in MIDDLE)
        there = ", ".join(capture.markers) or "no marker"
        raise RecordingError(f"{capture.name} has no leg: expected markers {expected}, or names; it has {there}")
    corners = [places[f"pelvis_{end}_{side}"] for end in ("front", "back") for side in SIDES]
    pelvis = PelvisMarkers(*corners) if all(corner is not None for corner in corners) else None
    return JointCentres(capture.time, legs["right"], legs["left"], pelvis)


def _called(point: str) -> str:
    return " or ".join(" and ".join(each) for each in NAMES[point]).replace("{}", "R")


def _point(capture: Capture, point: str, chosen: Mapping[str, str | Sequence[str]]) -> np.ndarray | None:
    """The mean of the markers that define a point; None where one is missing."""
    if point in chosen:
        wanted = [chosen[point]] if isinstance(chosen[point], str) else list(chosen[point])
        lacking = [str(marker) for marker in wanted if marker not in capture.markers]
        if lacking or not wanted:
            raise RecordingError(
                f"{capture.name} has no marker {', '.join(lacking) or 'at all'} (named for {point}); it has "
                f"{', '.join(capture.markers) or 'none'}"
            )
        return np.mean([capture.markers[str(marker)] for marker in wanted], axis=0)
    kind, _, side = point.rpartition("_")
    for each in NAMES[kind]:
        markers = [template.format(side[0].upper()) for template in each]
        if all(marker in capture.markers for marker in markers):
            return np.mean([capture.markers[marker] for marker in markers], axis=0)
    return None
