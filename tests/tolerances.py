"""Every numerical tolerance of the suite, with its reason."""

SVM_OBJECTIVE_GAP = 1e-4
"""Relative, ours against scikit-learn's LinearSVC (issue: 1e-4; measured: below 1e-9)."""
ONNX_SCORE = 1e-3
"""Absolute, log-likelihood ratios of torch against onnxruntime, which place the warp's samples some
1e-5 px apart (measured: 2e-4 at scores up to 12, 6e-4 where two frames are the same)."""
TWIN_SCORE = 2e-3
"""Absolute, `phi` against `oorc`: float32 features against float32 features in another order."""
FLOAT32 = 1e-5
"""Absolute, quantities of order 1 after a few float32 operations."""
FLOAT64 = 1e-9
"""Absolute, quantities of order 1 in float64."""
SUBPIXEL_PX = 0.02
"""Pixels, geometry through cv2's float32 homographies and interpolation."""
IDENTITY_LEVELS = 1
"""Gray levels, an image through an identity transform: rounding."""
NOISE_RELATIVE = 0.02
"""Relative, variance of 1.3 million noise samples: 0.12 % by chance, 0.5 % by 8-bit rounding."""
AUGMENT_LEVELS = 0.01
"""Gray levels, kornia's float32 warp and gamma at the identity (measured: 0.0013)."""
RESIDUAL_PX = 0.02
"""Pixels of motion that registration leaves of 1 px on a smooth picture (measured: 0.0135)."""
PHASE_MEAN = 1e-3
"""Relative, mean of the flicker over 2000 phases: piecewise linear, steepest at 5 % duty."""
MOIRE_AMPLITUDE = 0.01
"""Relative, moire's fundamental against drawn stripes (measured: 0.0025)."""
MOIRE_MEAN = 0.05
"""Absolute, mean of a field with whole and broken periods of amplitude up to 0.2."""
DEMOSAIC_RAMP = 1e-4
"""Absolute, exposure through the 16-bit integers that OpenCV demosaics (one step: 1.7e-5)."""
CDTF_LEVELS = 3.0
"""Gray levels: the pose is drawn within 1 degree, 2 to 4 % of light at 45 (measured: 2)."""
