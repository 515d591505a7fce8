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


def inverse_of_one(A: Tensor) -> Tensor:
    """Invert one (D, D) matrix in float64; the result is float32."""
    return inverse(A.double().unsqueeze(0))[0].float()


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
    N, D = X.shape[1:]
    root, none = (ridge / (2 * C)).sqrt(), X.new_zeros(N)
    # J / C is the sum of squares of what is left of the samples' slack, where it is positive, and
    # of weighted deviations from the prior, whatever their sign: rows aims - w.columns
    least = torch.cat([none, X.new_full((D,), -torch.inf)])
    aims = torch.cat([none + 1, root * prior])
    deviations = torch.diag(root).expand(X.shape[0], -1, -1)
    rows = torch.cat([y.unsqueeze(-1) * X, deviations], dim=1)  # (B, N + D, D)
    aimed = torch.cat([rows.transpose(1, 2), aims.expand(X.shape[0], 1, -1)], dim=1)

    def newton(counts: Tensor, rows: Tensor, aimed: Tensor) -> Tensor:
        both = (aimed * counts.to(rows.dtype)) @ rows  # (B, D + 1, D)
        return both[:, D:] @ inverse(both[:, :D])  # (B, 1, D)

    fixed = rows.detach(), aimed.detach()
    columns = fixed[1][:, :D].contiguous()
    sizes = torch.tensor(STEP_SIZES, dtype=X.dtype, device=X.device).reshape(-1, 1, 1)  # (S, 1, 1)
    most = torch.tensor(MAX_STEPS, device=X.device)

    def unsettled(step: Tensor, w: Tensor, left: Tensor, moving: Tensor) -> Tensor:
        return (step < most) & (moving.sum() > 0)

    def descend(
        step: Tensor, w: Tensor, left: Tensor, moving: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        counts = left > least
        direction = newton(counts, *fixed) - w
        change = direction @ columns
        trials = left - sizes[:, 0] * change  # (B, S, N + D)
        cost = torch.linalg.vector_norm(trials.maximum(least), dim=-1)
        size = sizes.index_select(0, cost.argmin(1))  # (B, 1, 1)
        changed = counts ^ (trials[:, 1:2] > least)  # by the whole step
        moving = changed.to(X.dtype).sum(-1)
        return step + 1, w + size * direction, left - size * change, moving

    w = prior.detach().expand(X.shape[0], 1, -1).clone()
    left = (aims.detach() - w @ columns).contiguous()
    moving = torch.ones_like(w[..., 0])  # (B, 1), how many samples became or ceased to be violators
    state = (torch.zeros((), dtype=torch.int64), w, left, moving)
    with torch.no_grad():
        if torch.compiler.is_exporting():
            state = torch.while_loop(unsettled, descend, state)  # type: ignore[no-untyped-call]
        else:
            while unsettled(*state):
                state = descend(*state)
    _, w, left, moving = state
    if torch.compiler.is_exporting():
        return w.squeeze(1)
    return torch.where(moving.unsqueeze(-1) > 0, w, newton(left > least, rows, aimed)).squeeze(1)
