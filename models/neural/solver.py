"""The per-frame convex fit: a squared-hinge SVM by Newton's method on the active set.

Batched, differentiable, and made of operations that export to ONNX; the iteration itself exports as
one Loop.
"""

import torch
from torch import Tensor

MAX_STEPS = 50
STEP_SIZES = (0.0, *(2.0 ** (-k / 2) for k in range(24)))
"""Of the search along Newton's direction; 0 stays."""


@torch.library.custom_op("camera_display::inverse", mutates_args=())
def exported_inverse(A: Tensor) -> Tensor:
    """Becomes onnxruntime's Inverse on export (`export.to_onnx`); torch.linalg does not export."""
    inverted: Tensor = torch.linalg.inv(A)
    return inverted


@exported_inverse.register_fake
def _(A: Tensor) -> Tensor:
    return torch.empty_like(A)


def inverse(A: Tensor) -> Tensor:
    """Inverse of (B, D, D) matrices, differentiable, the same shape."""
    operation = exported_inverse if torch.compiler.is_exporting() else torch.linalg.inv
    inverted: Tensor = operation(A)
    return inverted


def solve_spd(A: Tensor, y: Tensor) -> Tensor:
    """Solve A x = y.

    Args:
        A: (B, D, D) symmetric positive definite and well conditioned.
        y: (B, D).

    Returns:
        (B, D).
    """
    return (inverse(A) @ y.unsqueeze(-1)).squeeze(-1)


def objective(w: Tensor, margins: Tensor, ridge: Tensor, prior: Tensor) -> Tensor:
    """J(w) / 2 C = 1/2 sum_j ridge_j (w_j - prior_j)^2 + 1/2 sum_n max(0, 1 - w.z_n)^2.

    Args:
        w: (B, S, D): S heads for each frame.
        margins: (B, S, N), w.z_n with z the features times their labels.
        ridge: (D,), relative to 2 C.
        prior: (D,).

    Returns:
        (B, S).
    """
    slack, away = (1 - margins).relu(), w - prior  # (B, S, N), (B, S, D)
    return ((slack * slack).sum(-1) + (ridge * away * away).sum(-1)) / 2


def fit_head(X: Tensor, y: Tensor, C: Tensor, ridge: Tensor, prior: Tensor) -> Tensor:
    """Minimise J(w) = 1/2 sum_j ridge_j (w_j - prior_j)^2 + C sum_n max(0, 1 - y_n w.x_n)^2.

    With ridge 1 and prior 0 this is scikit-learn's ``LinearSVC(loss="squared_hinge")`` with the
    intercept as a feature of ones. J is piecewise quadratic: Newton's step solves a ridge system on
    the margin violators, and a search over step sizes keeps it from cycling. A step that leaves the
    violators what they were ends in the exact minimiser. It is taken once more with gradients: its
    derivative is that of the minimum.

    Args:
        X: (B, N, D) features, scaled to about 1, the last column of ones for the bias.
        y: (N,) labels, -1 or 1.
        C: () weight of the loss.
        ridge: (D,) positive.
        prior: (D,) mean of the head.

    Returns:
        w: (B, D).
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
