"""Method 3, OORC: calibration and bit decision in one convex SVM, the paper's main algorithm.

With g(i) = sum a_k i^k, the decision w (g(i_o) - g(i_e)) + b is linear in
    Phi(i_o, i_e) = [i_o^4 - i_e^4, i_o^3 - i_e^3, i_o^2 - i_e^2, i_o - i_e],
so an SVM in that space finds g and the threshold together. The differences of Legendre polynomials
P_k(2 i - 1) span the same space and keep the problem well conditioned. Since bit 1 makes i_e
brighter, weights come out negative.
"""

from dataclasses import dataclass

import numpy as np

from link.frames import SoftBits
from link.observation import Observation
from link.types import Real
from models.film.window import gray_frames
from models.paper.common import decode_with_svm
from models.paper.window import block_features, decode_window, smooth_terms


def legendre(i: Real, degree: int) -> Real:
    """Evaluate the Legendre polynomials P_1 ... P_degree at 2 i - 1.

    `models.phi.phi.legendre_maps` does it in torch and says why there are two functions.

    Args:
        i: (...) intensities in [0, 1].
        degree: number of polynomials, at least 1.

    Returns:
        (..., degree) values in [-1, 1].
    """
    x = 2 * i - 1
    terms = [np.ones_like(x), x]
    for k in range(1, degree):
        terms.append(((2 * k + 1) * x * terms[k] - k * terms[k - 1]) / (k + 1))
    return np.stack(terms[1 : degree + 1], axis=-1)


def explicit_map(i_o: Real, i_e: Real, degree: int = 4) -> Real:
    """Compute the features Phi of pixels, in the Legendre basis.

    Args:
        i_o: (...) intensities of the original in [0, 1].
        i_e: (...) intensities of the embedded frame in [0, 1].
        degree: degree of g.

    Returns:
        (..., degree) features.

    >>> explicit_map(np.array([0.5]), np.array([0.75]), degree=2)
    array([[-0.5  , -0.375]])
    """
    return np.asarray(legendre(i_o, degree) - legendre(i_e, degree))


@dataclass(frozen=True)
class OORC:
    """Optimal online radiometric calibration.

    >>> from link.embed import embed
    >>> from link.layout import make_layout
    >>> layout = make_layout()
    >>> picture = np.full((layout.height, layout.width, 3), 128, np.uint8)
    >>> bits = np.arange(layout.n_bits) % 2
    >>> shown = embed(picture, bits, layout, kappa=5)
    >>> pair = Observation.still(shown.original, shown.embedded, layout, kappa=5)
    >>> bool((OORC().decode(pair).bits == bits).all())
    True
    """

    degree: int = 4
    """Degree of the inverse response g; the paper's is 4."""
    C: float = 1.0
    """Weight of the SVM's squared hinge loss."""

    def decode(self, observation: Observation) -> SoftBits:
        """Score every message block of a frame pair, or of all pairs of a window of film.

        Raises:
            UnsuitedError: the layout has neither ratex patches nor pilots; or it is a film, and the
                layout has no pilots.
        """
        if not observation.is_pair:
            return self._decode_window(observation)

        def phi(i_o: Real, i_e: Real) -> Real:
            return explicit_map(i_o, i_e, self.degree)

        return decode_with_svm(observation, phi, self.C)

    def _decode_window(self, observation: Observation) -> SoftBits:
        """Fit one head to all frames, against their mean (`models.paper.window`)."""
        rows, cols = observation.layout.rows, observation.layout.cols
        frames = gray_frames(observation) / np.float32(255)  # (T, h, w)
        reference = frames.mean(0)
        maps = np.stack([explicit_map(reference, frame, self.degree) for frame in frames])
        features = block_features(np.moveaxis(maps, -1, 1), rows, cols)
        mean_alone = smooth_terms(np.zeros((rows, cols)))[:1]
        return decode_window(observation, features, mean_alone, own=False)
