"""What the paper's methods share: training samples, the SVM, and pooling over blocks.

Each method is a feature function u(i_o, i_e) of two captured intensities. The SVM trains on the
ratex pixels or pilots and scores the message pixels of the same frame pair.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from sklearn.svm import LinearSVC

from link.errors import UnsuitedError
from link.frames import SoftBits
from link.images import intensity
from link.layout import block_mean
from link.observation import Observation
from link.ratex import SAMPLES, TrainingPixels, training_pixels
from link.types import Real

Features = Callable[[Real, Real], Real]
"""Function of (...) intensities i_o and i_e in [0, 1] that returns (..., D) features."""


def tile_mean(samples: Real) -> Real:
    """Average over the samples of each ratex tile: (N, ...) becomes (tiles, ...)."""
    return np.asarray(samples.reshape(-1, SAMPLES * SAMPLES, *samples.shape[1:]).mean(axis=1))


def require_ratex(pair: Observation) -> TrainingPixels:
    """Return the training pixels of a frame pair.

    Raises:
        UnsuitedError: the layout has no ratex patch.
    """
    if not pair.layout.ratex:
        raise UnsuitedError("it trains on ratex patches and the layout has none")
    return training_pixels(pair.layout, pair.kappa or 0)


def training_samples(pair: Observation, maps: Real) -> tuple[Real, NDArray[np.intp]]:
    """Take the samples with known labels from feature maps: ratex tiles, or else pilots.

    A sample is the mean over the inner half of a tile, or over a pilot. A mean over 36 pixels has a
    36th of their noise variance.

    Args:
        pair: rectified frames, for their layout.
        maps: (H, W, D) features of every pixel.

    Returns:
        (N, D) features and (N,) labels, 0 or 1.

    Raises:
        UnsuitedError: the layout has neither ratex patches nor pilots.
    """
    layout = pair.layout
    if layout.ratex:
        pixels = require_ratex(pair)
        return tile_mean(maps[pixels.y, pixels.x]), pixels.label[:: SAMPLES * SAMPLES]
    if not layout.pilots:
        raise UnsuitedError("it trains on ratex patches or pilots and the layout has none")
    means = block_mean(np.moveaxis(maps, -1, 0), layout.rows, layout.cols)
    return means.reshape(len(means), -1).T[layout.pilot_blocks], layout.pilot_bits


def fit_svm(features: Real, labels: NDArray[np.intp], C: float) -> NDArray[np.float64]:
    """Fit a linear SVM to features that are first scaled to a root mean square of 1.

    It minimises 1/2 |w|^2 + 1/2 b^2 + C sum max(0, 1 - y (w.u + b))^2.

    Args:
        features: (N, D) features.
        labels: (N,) bits, 0 or 1.
        C: weight of the squared hinge loss.

    Returns:
        (D + 1,) weights of the features as they are, not standardised, and then the bias.
    """
    scale = np.sqrt(np.mean(np.square(features, dtype=np.float64), axis=0)) + 1e-9
    svm = LinearSVC(C=C, loss="squared_hinge", dual=False, tol=1e-6, max_iter=5000)
    svm.fit(features / scale, labels)
    return np.append(svm.coef_[0] / scale, svm.intercept_[0])


def decode_with_svm(pair: Observation, features: Features, C: float) -> SoftBits:
    """Train an SVM on the ratex pixels or pilots of a frame pair and score its message blocks.

    Args:
        pair: rectified frames.
        features: the method's feature function u(i_o, i_e).
        C: weight of the SVM's squared hinge loss.

    Returns:
        scores of the message blocks, and the head: (D + 1,) weights, then the bias.

    Raises:
        UnsuitedError: the layout has neither ratex patches nor pilots.
    """
    i_o, i_e = (intensity(f) for f in (pair.original, pair.embedded))
    maps = features(i_o, i_e)
    head = fit_svm(*training_samples(pair, maps), C)
    scores = maps @ head[:-1] + head[-1]
    blocks = block_mean(scores, pair.layout.rows, pair.layout.cols)[pair.layout.message_mask]
    return SoftBits(np.asarray(blocks, np.float64), head)


def decode_by_difference(
    pair: Observation, g: Callable[[Real], Real], threshold: float | None, C: float
) -> SoftBits:
    """Score every message block by one feature, the difference g(i_e) - g(i_o).

    Args:
        pair: rectified frames.
        g: inverse response, from captured intensities in [0, 1].
        threshold: difference, in units of g, above which a bit is 1; None where an SVM learns it on
            the ratex pixels or pilots of the frame pair.
        C: weight of the SVM's squared hinge loss.

    Raises:
        UnsuitedError: the layout has neither ratex patches nor pilots to learn a threshold on.
    """
    if threshold is None:
        return decode_with_svm(pair, lambda i_o, i_e: np.asarray(g(i_e) - g(i_o))[..., None], C)
    difference = g(intensity(pair.embedded)) - g(intensity(pair.original))
    blocks = block_mean(difference - threshold, pair.layout.rows, pair.layout.cols)
    return SoftBits(np.asarray(blocks[pair.layout.message_mask], np.float64))
