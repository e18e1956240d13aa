"""The angles of a leg in the vertical plane of the heading, from joint centres. On the host, in NumPy."""

import numpy as np

from jgait.types import LegTrajectory


def low_pass_heading(heading: np.ndarray, rate_hz: float) -> np.ndarray:
    """The unwrapped heading (T,) [rad] by a second-order Butterworth filter, forwards and backwards, without delay.

    Its cut-off is 1 Hz: the pelvis also turns about the vertical in every stride, while the direction of walking stays
    the same.
    """
    from scipy.signal import butter, filtfilt

    return filtfilt(*butter(2, 1.0 / (rate_hz / 2)), heading, axis=0)


def path_walked(position: np.ndarray, rate_hz: float, smoothing_s: float = 0.2) -> np.ndarray:
    """Length of the smoothed horizontal path since the first sample (T,) [m], of positions (T, 2) [m].

    A Gaussian of the standard deviation `smoothing_s` damps sway, and does not ring where walking starts, as a
    Butterworth filter does.
    """
    from scipy.ndimage import gaussian_filter1d

    smooth = gaussian_filter1d(position, smoothing_s * rate_hz, axis=0, mode="nearest")
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(smooth, axis=0), axis=1))])


def leg_in_plane(hip: np.ndarray, knee: np.ndarray, ankle: np.ndarray, heading: np.ndarray) -> LegTrajectory:
    """Joint centres (T, 3) [m], z up, projected on the vertical plane through the heading (T,) [rad]."""

    def forward(vector: np.ndarray) -> np.ndarray:
        return vector[:, 0] * np.cos(heading) + vector[:, 1] * np.sin(heading)

    thigh, shank, leg = knee - hip, ankle - knee, ankle - hip
    thigh_angle = np.unwrap(np.arctan2(forward(thigh), -thigh[:, 2]))
    shank_angle = np.unwrap(np.arctan2(forward(shank), -shank[:, 2]))
    return LegTrajectory(thigh_angle, thigh_angle - shank_angle, forward(leg), leg[:, 2])
