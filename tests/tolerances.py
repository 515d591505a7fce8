"""Every numerical tolerance of the suite, with its reason."""

SVM_OBJECTIVE_GAP = 1e-4
"""Relative difference between the objective that our solver reaches and that of scikit-learn's
LinearSVC; the largest that was measured is below 1e-9."""
ONNX_SCORE = 1e-3
"""Absolute difference between the log-likelihood ratios of torch and onnxruntime. The two place the
warp's samples some 1e-5 px apart, which made a difference of 2e-4 at scores up to 12, and of 6e-4
where the two frames are the same."""
TWIN_SCORE = 2e-3
"""Absolute difference between the scores of `phi` and `oorc`, which compute the same features in
float32 in another order."""
FLOAT32 = 1e-5
"""Absolute error of quantities of order 1 after a few float32 operations."""
FLOAT64 = 1e-9
"""Absolute error of quantities of order 1 after a few float64 operations."""
SUBPIXEL_PX = 0.02
"""Error in pixels of geometry that goes through OpenCV's float32 homographies and interpolation."""
IDENTITY_LEVELS = 1
"""Gray levels by which rounding may change an image in a transform that changes nothing."""
NOISE_RELATIVE = 0.02
"""Relative error of a variance estimated from 1.3 million noise samples: chance makes 0.12 %, and
rounding to 8 bits makes 0.5 %."""
AUGMENT_LEVELS = 0.01
"""Gray levels by which kornia's warp and gamma in float32 may change an image when both are set to
change nothing; 0.0013 was measured."""
RESIDUAL_PX = 0.02
"""Pixels that registration may leave of a motion of 1 px on a smooth picture; 0.0135 was
measured."""
PHASE_MEAN = 1e-3
"""Relative error of the mean of the backlight's flicker over 2000 phases. The flicker is piecewise
linear in the phase, and steepest where the light is on for 5 % of the time."""
MOIRE_AMPLITUDE = 0.01
"""Relative difference between the amplitude of the computed moire and that of drawn stripes; 0.0025
was measured."""
MOIRE_MEAN = 0.05
"""Absolute distance from 1 of the mean of a moire field of amplitude up to 0.2, which holds whole
periods and parts of periods."""
DEMOSAIC_RAMP = 1e-4
"""Absolute error of an exposure that goes through the 16-bit integers that OpenCV demosaics; one
step of them is 1.7e-5."""
CDTF_LEVELS = 3.0
"""Gray levels between a measured transfer function and the simulated one. The pose is drawn within
1 degree, which changes the light by 2 to 4 % at 45 degrees; 2 gray levels were measured."""
