"""How visible a message is: contrast over threshold of what a display really shows over time.

One block's gray levels at every refresh become light (`Viewing.light`); its luminance is cut into
windows of half a second; in each window the amplitude of every temporal frequency, divided by the
mean, is divided by its own threshold (`sender.visibility.elatcsf`), and the squares are added. The
root is the *contrast over threshold*: a sine at its threshold has 1, and above 1 the flicker is
seen more often than not.

- **Pooling over frequencies.** The paper of elaTCSF measures one frequency at a time. That the
  components of a waveform count in quadrature, each over its own threshold, is the metric of
  Bodington, Bierman and Narendran, "A flicker perception metric", Lighting Research & Technology
  48(5), 2016, who found it to predict thresholds for many waveforms. By Parseval's theorem the sum
  does not depend on the window's length for random messages, and not on the fineness of the
  frequencies; for a square wave it is the fundamental and very little more.
- **Windows.** Half a second, without overlap or taper, is about what the eye adds up. The window's
  mean is taken off, so that drifts slower than 2 Hz count only in part.
- **Held light.** A display is taken to hold each frame until the next (LCD, OLED without strobe).
  The spectrum of such light is that of the frames, repeated about the refresh rate and its
  multiples, times sinc(f / refresh). Frequencies above `HIGHEST_HZ` are left out; at 120 Hz the
  sensitivity is thousands of times below its peak. Backlights that are switched add nothing here:
  they flicker without a message as well.
- **Not modelled**: the picture's texture, which masks; the edges of blocks, their number and their
  spatial frequency; eyes that move, for which `stroboscopic_visibility` knows a part. The whole
  screen in phase
  (`where="screen"`) is the upper end of what many blocks together can do.
"""

import numpy as np
from numpy.typing import ArrayLike

from link.embed import BEFORE
from link.errors import InputError
from link.layout import MODULATIONS
from link.types import Array
from sender.visibility.elatcsf import flicker_sensitivity
from sender.visibility.viewing import Viewing, Where

WINDOW_S = 0.5
"""Length of the windows in which flicker is judged, in seconds."""
HIGHEST_HZ = 120.0
"""Highest temporal frequency that is counted, in Hz."""
MOVING_HZ = 80.0, 2000.0
"""Lowest and highest temporal frequency that `stroboscopic_visibility` counts, in Hz."""
MOVING_EXPONENT = 3.7
"""Exponent by which `stroboscopic_visibility` sums over frequencies."""
MOVING_THRESHOLD = 2.865e-5, 1.543, 0.225
"""Factor, exponent and offset of the contrast at which a sine is just seen to draw a row of images:
factor x Hz ^ exponent + offset."""
QUANTILE = 0.95
"""Share of the windows of a random message that lie below what is called its high end."""


def high_end(windows: Array) -> float:
    """Return the contrast over threshold below which 95 % of the windows lie."""
    return float(np.quantile(windows, QUANTILE))


def flicker_spectrum(
    values: ArrayLike, sample_hz: float, highest_hz: float = HIGHEST_HZ
) -> tuple[Array, Array]:
    """Take held values apart into sines, up to a frequency.

    Args:
        values: (..., n) values that follow each other, each held until the next.
        sample_hz: number of values a second.
        highest_hz: highest frequency wanted, in Hz.

    Returns:
        (F,) frequencies in Hz, from one period in n values on, and (..., F) amplitudes, such that a
        held sine of amplitude a and frequency f well below ``sample_hz`` has a times
        sinc(f / sample_hz), which is about a.

    >>> square = [1.0, -1.0] * 8  # its fundamental is 4 / pi
    >>> hz, amplitudes = flicker_spectrum(square, sample_hz=60, highest_hz=90)
    >>> float(hz[amplitudes.argmax()]), round(float(amplitudes.max()), 4)
    (30.0, 1.2732)
    """
    samples = np.asarray(values, np.float64)
    n = samples.shape[-1]
    spectrum = np.abs(np.fft.fft(samples, axis=-1)) * 2 / n
    count = max(1, int(highest_hz * n / sample_hz + 1e-9))
    numbers = np.arange(1, count + 1)
    return numbers * sample_hz / n, spectrum[..., numbers % n] * np.abs(np.sinc(numbers / n))


def contrast_over_threshold(
    amplitudes: ArrayLike, viewing: Viewing, where: Where = "block"
) -> Array:
    """Work out how visible a sequence is that one block, or the whole screen, shows.

    Args:
        amplitudes: (T,) what is added to the picture at each refresh, in units of kappa; what is
            left over beyond the last whole window is not used.
        viewing: display, picture, kappa and viewer.
        where: "block" for one block alone, looked at from `Viewing.gazes_deg`, of which the most
            visible counts; "screen" for all blocks in phase, looked at in the middle.

    Returns:
        (windows,) contrast over threshold of the luminance in each window, by elaTCSF; 1 is just
        seen.

    Raises:
        InputError: the sequence is shorter than one window.

    >>> toggling = np.tile([-0.5, 0.5], 30)
    >>> round(float(contrast_over_threshold(toggling, Viewing(rows=48, cols=64)).mean()), 2)
    0.71
    """
    n = round(WINDOW_S * viewing.refresh_hz)
    levels = viewing.gray_levels(amplitudes)
    if n < 2 or len(levels) < n:
        raise InputError(
            f"a sequence of {len(levels)} refreshes is shorter than one window of {WINDOW_S:g} s"
        )
    luminance = viewing.light(levels[: len(levels) // n * n])
    mean = float(luminance.mean())
    hz, contrast = flicker_spectrum(luminance.reshape(-1, n) / mean, viewing.refresh_hz)
    width, height = viewing.degrees(where)
    adapted = float(f"{mean:.3g}")  # thresholds are kept by luminance; 0.5 % does not change them
    gazes = viewing.gazes_deg if where == "block" else (0.0,)
    seen = [
        np.sqrt(
            np.square(contrast) @ np.square(flicker_sensitivity(hz, adapted, width, height, gaze))
        )
        for gaze in gazes
    ]
    return max(seen, key=lambda windows: float(windows.mean()))


def stroboscopic_visibility(amplitudes: ArrayLike, viewing: Viewing) -> float:
    """Work out the stroboscopic visibility measure (SVM) of CIE TN 006: what moves in such light.

    A moving thing, or a moved eye, turns flicker into a row of images. Band, sum and thresholds are
    those of IEC TR 63158:2018; the thresholds were measured by Perz, Sekulovski, Vogels and
    Heynderickx, "Stroboscopic effect: contrast threshold function and dependence on illumination
    level", JOSA A 35(2), 2018, https://doi.org/10.1364/JOSAA.35.000309, for lamps that light a
    room with more than 100 lx, and movements of up to 4 m/s.

    Args:
        amplitudes: (T,) what is added to the picture at each refresh, in units of kappa: whole
            periods, a second or longer.
        viewing: display, picture and kappa.

    Returns:
        1 where half of the people see it; frequencies below 80 Hz do not count.

    >>> toggling = np.tile([-0.5, 0.5], 30)
    >>> round(stroboscopic_visibility(toggling, Viewing(picture_level=32, kappa=1)), 3)
    0.037
    """
    light = viewing.light(viewing.gray_levels(amplitudes))
    lowest, highest = MOVING_HZ
    hz, contrast = flicker_spectrum(light / light.mean(), viewing.refresh_hz, highest)
    factor, exponent, offset = MOVING_THRESHOLD
    over = contrast / (factor * hz**exponent + offset)
    return float((over[hz >= lowest] ** MOVING_EXPONENT).sum() ** (1 / MOVING_EXPONENT))


def random_message(
    viewing: Viewing, modulation: str, rng: np.random.Generator, seconds: float
) -> Array:
    """Draw what a block shows of a random message.

    Args:
        viewing: gives the rates of states and refreshes.
        modulation: a key of `link.layout.MODULATIONS`; blocks change around the picture as
            `link.embed.embed` makes them.
        rng: draws the bits.
        seconds: length of the message, in seconds.

    Returns:
        (refreshes in ``seconds``,) what is added to the picture, in units of kappa.

    >>> random_message(Viewing(), "antipodal", np.random.default_rng(0), seconds=0.1)
    array([-0.5,  0.5, -0.5,  0.5, -0.5,  0.5])
    """
    wanted = round(seconds * viewing.refresh_hz)
    bits = rng.integers(0, 2, wanted // (2 * viewing.refreshes) + 2)
    changes, before = np.array(MODULATIONS[modulation])[bits], BEFORE[modulation]
    states = np.column_stack([-before * changes, (1 - before) * changes])
    return np.repeat(states.ravel(), viewing.refreshes)[:wanted]
