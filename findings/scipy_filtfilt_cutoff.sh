#!/usr/bin/env bash
# scipy 1.15.3 (scipy.signal.sosfiltfilt, filtfilt).
# Expected: a Butterworth low-pass designed for 6 Hz and run forward and backward keeps
#   71 % of the amplitude (-3 dB) at 6 Hz, as the design says.
# Seen: it keeps 50 % (-6 dB), because both passes act; the -3 dB point of the two passes
#   together lies at 5.39 Hz for order 4. Dividing the frequency by (sqrt(2) - 1)^(1 / (2 n)) in the
#   design, on the pre-warped scale, moves it back to 6 Hz.
# For gait: '4th order, 6 Hz, zero lag' in a paper can mean two different filters, and
#   peaks at heel strike differ between them.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile \
    numpy==2.2.6 scipy==1.15.3

"$work/venv/bin/python" - <<'EOF'
import numpy as np
from scipy import signal

RATE, CUTOFF, ORDER = 100.0, 6.0, 4
t = np.arange(6000) / RATE
tone = np.sin(2 * np.pi * CUTOFF * t)


def design(frequency):
    return signal.butter(ORDER, frequency, fs=RATE, output="sos")


def kept(y):
    """Amplitude of the 6 Hz tone in the middle of the record."""
    s, c = np.sin(2 * np.pi * CUTOFF * t), np.cos(2 * np.pi * CUTOFF * t)
    middle = slice(1000, 5000)  # a whole number of periods
    return 2 * np.hypot(np.mean(y[middle] * s[middle]), np.mean(y[middle] * c[middle]))


def minus_3_db(sos):
    w, h = signal.sosfreqz(sos, worN=50000, fs=RATE)
    return w[np.argmax(np.abs(h) ** 2 <= np.sqrt(0.5))]


once, twice = kept(signal.sosfilt(design(CUTOFF), tone)), kept(signal.sosfiltfilt(design(CUTOFF), tone))
factor = (np.sqrt(2) - 1) ** (1 / (2 * ORDER))
warped = np.tan(np.pi * CUTOFF / RATE) / factor
mended = np.arctan(warped) * RATE / np.pi
thrice = kept(signal.sosfiltfilt(design(mended), tone))
print(f"one pass keeps {once:.3f}, forward and backward {twice:.3f} of the amplitude at {CUTOFF} Hz")
print(f"-3 dB point forward and backward: {minus_3_db(design(CUTOFF)):.2f} Hz")
print(f"designed for {mended:.2f} Hz: keeps {thrice:.3f} at {CUTOFF} Hz")

assert abs(once - np.sqrt(0.5)) < 0.005
assert abs(twice - 0.5) < 0.005, "two passes now keep the design's cut-off"
assert abs(minus_3_db(design(CUTOFF)) - 5.39) < 0.02
assert abs(thrice - np.sqrt(0.5)) < 0.005
EOF
