"""Every numerical tolerance of the suite, with its reason."""

SVM_OBJECTIVE_GAP = 1e-4
"""Relative difference between the objective that our solver reaches and that of scikit-learn's
LinearSVC; the largest that was measured is below 1e-9."""
ONNX_SCORE = 1e-3
"""Absolute difference between the log-likelihood ratios of torch and onnxruntime. The two place the
warp's samples some 1e-5 px apart, which made a difference of 2e-4 at scores up to 12, and of 6e-4
where the two frames are the same."""
FILM_SCORE = 0.1
"""Absolute difference between the film decoder's log-likelihood ratios in torch, onnxruntime and
the page: its rounds are in float32, where differences of 1e-5 in a fit become 0.03 in a score."""
LOG_ODDS = 1e-3
"""Absolute difference between the log-odds of a map in torch, in onnxruntime and on the page."""
CERTAINTY = 1e-3
"""Absolute difference between a factor found by four Newton steps and by SciPy's bounded search."""
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

# Between the page's JavaScript and Python

SAME_STEPS = 1e-12
"""Absolute error of quantities of order 1 that both compute in float64 by the same operations."""
FLOAT32_SUM = 1e-4
"""Absolute difference between sums of some hundred terms of order 1 to 100, which the two take in
float32 in another order: log-likelihood ratios, mean gray levels."""
FITTED = 1e-6
"""Absolute difference between numbers of order 1 that iterations in float64 have settled on, which
end where the last bits decide; for the parameters of a clock, in periods."""
CLOCK_STATE = 1e-5
"""Absolute difference between phase errors, and between what a synchroniser says of its clock; both
follow from many fits."""
CLOCK_EVIDENCE = 1e-3
"""Absolute difference between evidences of clocks, which are of order 100 to 1000."""
SHRUNK_LEVELS = 1e-3
"""Gray levels between pixels of order 100 after float32 interpolation."""
PROFILE_LEVELS = 0.4
"""Gray levels, of a mean over 32 places of a side, between what a page and OpenCV sample: each
value is rounded to a whole level, and OpenCV's weights of pixels are whole 32768ths."""
ROUNDED_LEVELS = 1
"""Gray levels by which a pixel of 8 bits may differ where interpolation falls between two."""
SHRUNK_MEAN = 2e-3
"""Mean difference in gray levels of images that were shrunk to 8 bits: few pixels round apart."""
GROWN_MEAN = 0.2
"""Mean difference in gray levels of images that grew: OpenCV interpolates bytes with whole numbers,
which round a little differently."""
RECTIFIED_MEAN = 0.05
"""Mean difference in gray levels of rectified images, of which few pixels round apart."""
STILL_MEAN = 0.3
"""Mean difference in gray levels of frames that were warped to lie still."""
MOVED_SCORE_MEAN = 0.1
"""Mean difference between scores, 3 on average, of windows of noise in which Python and the page
have each found how the picture moves; 0.06 was measured."""
COMPENSATED_MEAN = 0.5
"""Mean difference in levels of images of changes, of which four are a gray level: points of optical
flow end some hundredths of a pixel apart."""
VIEW_MEAN = 3.0
"""Mean difference in gray levels of small views of a texture, whose deviation is 20."""
SAME_PX = 0.01
"""Pixels between places that Python and the page find by the same steps in the same image."""
CORNERS_PX = 0.1
"""Pixels between corners that iterations of another resolution have moved onto edges or
pilots, or between points that such a motion moves."""
OUTLINE_CELLS = 1e-3
"""Cells by which the page's outlines of regions may differ from Python's. Both climb by the same
steps, of which the smallest is four hundred times as long; sums differ by rounding."""
MOVED_PX = 1e-3
"""Pixels between points that were moved by the same homography, of which Python has float32."""
DECODED_PX = 2e-3
"""Layout pixels between corners that were moved to where decoded blocks lie."""
LENS_K = 3e-4
"""Absolute difference between coefficients of a lens, which are up to 0.15, that both settle on."""
FOUND_PX = 0.3
"""Pixels between corners of a display that both searches find."""
PROPOSED_PX = 4.0
"""Pixels between corners that edges propose and true ones, or those that Python proposes: some two
of the small image in which edges are looked for."""
SNAPPED_PX = 1.5
"""Pixels between sides that snap to edges: steps of a pixel are tried, and two may be as good."""
SIDE_FEATURES = 0.03
"""Absolute difference between shares of a side's places: one whose step is as large as the least
that counts may be counted or not."""
PILOT_CHANGE = 2e-3
"""Gray levels between amplitudes in maps of what toggles, after float32 sums over frames."""
PILOTS_FOUND_PX = 1.5
"""Pixels by which the page's corners may be farther from the truth than Python's: an eighth of the
blocks of these films. Whether a move of the corners made the display surer is decided by noise
where it was sure before."""
FOLLOWED_PX = 0.7
"""Pixels between the corners of a display that is followed by its patches and the true ones."""
CORNERS_WORSE_PX = 0.5
"""Mean distance in pixels, along each axis, by which the page's corners of a film may be farther
from the truth than Python's."""
CLOCKS_APART = 0.05
"""Share by which rates of states may differ; the first fit looks back a second or less."""
EVEN_CONTRAST = 1.05
"""Largest ratio of the contrast over threshold between two gray levels that the table of
`link.strength` makes alike; its factors are rounded to 0.01 and drawn for one message."""
