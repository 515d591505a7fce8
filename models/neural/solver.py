"""The per-frame convex fit: a squared-hinge SVM by Newton's method on the active set.

Batched, differentiable, and made of operations that export to ONNX; the iteration itself exports as
one Loop.
"""

import torch
from torch import Tensor

MAX_STEPS = 50
STEP_SIZES = (0.0, *(2.0 ** (-k / 2) for k in range(24)))
"""Of the search along Newton's direction; 0 stays."""
TOLERANCE = 1e-10
"""Relative decrease of the objective below which a frame has converged."""


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


def objective(w: Tensor, X: Tensor, y: Tensor, C: Tensor, ridge: Tensor, prior: Tensor) -> Tensor:
    """J(w) = 1/2 sum_j ridge_j (w_j - prior_j)^2 + C sum_n max(0, 1 - y_n w.x_n)^2.

    Args:
        w: (B, S, D): S heads for each frame.
        X: (B, N, D).
        y: (N,).
        C: ().
        ridge: (D,).
        prior: (D,).

    Returns:
        (B, S).
    """
    slack = torch.relu(1 - y * (w @ X.transpose(1, 2)))  # (B, S, N)
    return 0.5 * (ridge * (w - prior) ** 2).sum(-1) + C * (slack**2).sum(-1)


def fit_head(X: Tensor, y: Tensor, C: Tensor, ridge: Tensor, prior: Tensor) -> Tensor:
    """Minimise `objective` for every frame of a batch.

    With ridge 1 and prior 0 this is scikit-learn's ``LinearSVC(loss="squared_hinge")`` with the
    intercept as a feature of ones. J is piecewise quadratic: Newton's step solves a ridge system on
    the margin violators, and a search over step sizes keeps it from cycling. The last step is
    taken with gradients: once the active set has settled it is the exact minimiser, and its
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

    def newton(w: Tensor, X: Tensor, C: Tensor, ridge: Tensor, prior: Tensor) -> Tensor:
        # X is transposed before it is weighted: onnxruntime 1.31 gets the transpose of a product
        # wrong inside a Loop
        active = (y * (X @ w.unsqueeze(-1)).squeeze(-1) < 1).to(X.dtype)
        weighted = (2 * C) * X.transpose(1, 2) * active.unsqueeze(1)  # (B, D, N)
        return solve_spd(torch.diag(ridge) + weighted @ X, ridge * prior + weighted @ y)

    fixed = [t.detach() for t in (X, C, ridge, prior)]
    sizes = torch.tensor(STEP_SIZES, dtype=X.dtype, device=X.device).unsqueeze(-1)  # (S, 1)

    def loss(w: Tensor) -> Tensor:
        return objective(w, fixed[0], y, *fixed[1:])

    def unsettled(step: Tensor, w: Tensor, decrease: Tensor) -> Tensor:
        return (step < MAX_STEPS) & (decrease > TOLERANCE).any()

    def descend(step: Tensor, w: Tensor, decrease: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        direction = newton(w, *fixed) - w
        losses = loss(w.unsqueeze(1) + sizes * direction.unsqueeze(1))  # (B, S)
        best, chosen = losses.min(dim=1)
        here = losses[:, 0]
        return step + 1, w + sizes[chosen] * direction, (here - best) / here

    w = fixed[3].expand(X.shape[0], X.shape[2]).clone()
    state = (torch.zeros((), dtype=torch.int64), w, torch.ones_like(w[:, 0]))
    with torch.no_grad():
        if torch.compiler.is_exporting():
            state = torch.while_loop(unsettled, descend, state)  # type: ignore[no-untyped-call]
        else:
            while unsettled(*state):
                state = descend(*state)
    w = state[1]
    final = newton(w, X, C, ridge, prior)
    ends = loss(torch.stack([final.detach(), w], dim=1))
    settled = ends[:, :1] <= ends[:, 1:] * (1 + 1e-9)
    return torch.where(settled, final, w)
