"""The convex fit of each frame pair: a squared-hinge SVM by Newton's method on the active set.

It is batched, differentiable, and made of operations that export to ONNX. The iteration itself
exports as one Loop.
"""

import torch
from torch import Tensor

MAX_STEPS = 50
"""Largest number of Newton steps; a fit that has not settled by then keeps its last weights."""
STEP_SIZES = (0.0, *(2.0 ** (-k / 2) for k in range(24)))
"""Lengths that are tried along Newton's direction, as shares of the whole step; 0 does not move."""


@torch.library.custom_op("camera_display::inverse", mutates_args=())
def exported_inverse(A: Tensor) -> Tensor:
    """Invert (B, D, D) matrices; on export `export.to_onnx` makes onnxruntime's Inverse of this.

    torch.linalg itself does not export.
    """
    inverted: Tensor = torch.linalg.inv(A)
    return inverted


@exported_inverse.register_fake
def _(A: Tensor) -> Tensor:
    return torch.empty_like(A)


def inverse(A: Tensor) -> Tensor:
    """Invert (B, D, D) matrices, differentiably; the result has the same shape."""
    operation = exported_inverse if torch.compiler.is_exporting() else torch.linalg.inv
    inverted: Tensor = operation(A)
    return inverted


def solve_spd(A: Tensor, y: Tensor) -> Tensor:
    """Solve A x = y for a batch of small systems.

    Args:
        A: (B, D, D) symmetric positive definite and well conditioned.
        y: (B, D) right-hand sides.

    Returns:
        x: (B, D) solutions.

    >>> solve_spd(torch.tensor([[[2.0, 0.0], [0.0, 4.0]]]), torch.tensor([[2.0, 2.0]])).tolist()
    [[1.0, 0.5]]
    """
    return (inverse(A) @ y.unsqueeze(-1)).squeeze(-1)


def objective(w: Tensor, margins: Tensor, ridge: Tensor, prior: Tensor) -> Tensor:
    """Evaluate what `fit_head` minimises, divided by 2 C.

    J(w) / 2 C = 1/2 sum_j ridge_j (w_j - prior_j)^2 + 1/2 sum_n max(0, 1 - w.z_n)^2, where z_n are
    the features of sample n times its label.

    Args:
        w: (B, S, D) heads, S candidates for each frame pair.
        margins: (B, S, N) products w.z_n.
        ridge: (D,) weight of each squared deviation from the prior, divided by 2 C.
        prior: (D,) mean of the head.

    Returns:
        (B, S) values of J / 2 C.
    """
    slack, away = (1 - margins).relu(), w - prior  # (B, S, N), (B, S, D)
    return ((slack * slack).sum(-1) + (ridge * away * away).sum(-1)) / 2


def fit_head(X: Tensor, y: Tensor, C: Tensor, ridge: Tensor, prior: Tensor) -> Tensor:
    """Fit the linear head of each frame pair by minimising a convex objective J.

    J(w) = 1/2 sum_j ridge_j (w_j - prior_j)^2 + C sum_n max(0, 1 - y_n w.x_n)^2

    With ridge 1 and prior 0 this is scikit-learn's ``LinearSVC(loss="squared_hinge")`` with the
    intercept as a feature of ones. J is piecewise quadratic: Newton's step solves a ridge system on
    the margin violators, and a search over step sizes keeps it from cycling. A step that leaves the
    violators what they were ends in the exact minimiser. That step is taken once more with
    gradients, and its derivative is the derivative of the minimum.

    Args:
        X: (B, N, D) features, scaled to about 1; the last column holds ones for the bias.
        y: (N,) labels, -1 or 1, which all frame pairs share.
        C: () weight of the squared hinge loss, positive.
        ridge: (D,) weight of each squared deviation from the prior, positive.
        prior: (D,) mean of the head.

    Returns:
        w: (B, D) weights, the last of which is the bias.

    A feature that is 1 for label 1 and -1 for label -1 needs the weight 4 / 5 here, and no bias:

    >>> X = torch.tensor([[[1.0, 1.0], [-1.0, 1.0]]])
    >>> y, one = torch.tensor([1.0, -1.0]), torch.tensor(1.0)
    >>> fit_head(X, y, C=one, ridge=torch.ones(2), prior=torch.zeros(2)).tolist()
    [[0.800000011920929, 0.0]]
    """

    def newton(w: Tensor, Z: Tensor, Zt: Tensor, ridge: Tensor, prior: Tensor) -> Tensor:
        violators = Zt * (w.unsqueeze(1) @ Zt < 1).to(Zt.dtype)  # (B, D, N)
        # Zt comes transposed: onnxruntime 1.31 gets the transpose of a product wrong inside a Loop
        return solve_spd(torch.diag(ridge) + violators @ Z, ridge * prior + violators.sum(-1))

    Z, ridge = y.unsqueeze(-1) * X, ridge / (2 * C)  # (B, N, D): margins are Z w
    given = (Z, Z.transpose(1, 2).contiguous(), ridge, prior)
    fixed = [t.detach() for t in given]
    sizes = torch.tensor(STEP_SIZES, dtype=X.dtype, device=X.device).unsqueeze(-1)  # (S, 1)

    def unsettled(step: Tensor, w: Tensor, moving: Tensor) -> Tensor:
        return (step < MAX_STEPS) & moving.any()

    def descend(step: Tensor, w: Tensor, moving: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        direction = newton(w, *fixed) - w
        trials = w.unsqueeze(1) + sizes * direction.unsqueeze(1)  # (B, S, D)
        margins = trials @ fixed[1]  # (B, S, N)
        best = objective(trials, margins, *fixed[2:]).argmin(1)
        violated = margins[:, :2] < 1  # by staying, and by the whole step
        moving = (violated[:, 0] != violated[:, 1]).any(-1)
        return step + 1, w + sizes[best] * direction, moving

    w = fixed[3].expand(X.shape[0], X.shape[2]).clone()
    moving = torch.ones_like(w[:, 0], dtype=torch.bool)
    state = (torch.zeros((), dtype=torch.int64), w, moving)
    with torch.no_grad():
        if torch.compiler.is_exporting():
            state = torch.while_loop(unsettled, descend, state)  # type: ignore[no-untyped-call]
        else:
            while unsettled(*state):
                state = descend(*state)
    _, w, moving = state
    if torch.compiler.is_exporting():
        return w
    return torch.where(moving.unsqueeze(-1), w, newton(w, *given))
