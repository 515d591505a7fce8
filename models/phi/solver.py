"""The convex fit of each frame pair: a squared-hinge SVM by Newton's method (paper, section 4).

It is batched, differentiable, and made of operations that export to ONNX, where the iteration
becomes one Loop.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from models.onnx_ops import inverse, repeat_while

MAX_STEPS = 50
"""Largest number of Newton steps; a fit that has not converged by then keeps its last weights."""
STEP_SIZES = (0.0, *(2.0 ** (-k / 2) for k in range(24)))
"""Lengths that are tried along Newton's direction, as shares of the whole step; 0 does not move."""


@dataclass(frozen=True)
class HeadProblem:
    """The objective of a head as a sum of squares, one of each of R = N + D rows.

    The rows are the N samples, each of which counts while its slack is positive, and one for each
    of the D weights, whose deviation from its prior always counts:
    J(w) / C = sum_r max(aim_r - w.row_r, least_r)^2.
    """

    rows: Tensor
    """(B, R, D) the rows."""
    columns_and_aims: Tensor
    """(B, D + 1, R) the same rows, transposed, and below them the aims."""
    least: Tensor
    """(R,) 0 for samples and -inf for weights."""

    @property
    def columns(self) -> Tensor:
        """(B, D, R) the rows, transposed."""
        # a slice of the tensor above would be the same, but onnxruntime warns of slices that a loop
        # takes from outside
        return self.rows.transpose(1, 2).contiguous()

    def detach(self) -> "HeadProblem":
        """Give the same problem without gradients."""
        return HeadProblem(self.rows.detach(), self.columns_and_aims.detach(), self.least)

    def slack(self, w: Tensor) -> Tensor:
        """Compute what (B, 1, D) weights leave of the aims: (B, 1, R)."""
        slack: Tensor = self.columns_and_aims[:, self.rows.shape[2] :] - w @ self.columns
        return slack


def head_problem(X: Tensor, y: Tensor, C: Tensor, ridge: Tensor, prior: Tensor) -> HeadProblem:
    """Write the objective of `fit_head`, whose arguments these are, as a sum of squares."""
    N, D = X.shape[1:]
    root, none = (ridge / (2 * C)).sqrt(), X.new_zeros(N)
    least = torch.cat([none, X.new_full((D,), -torch.inf)])
    aims = torch.cat([none + 1, root * prior])
    rows = torch.cat([y.unsqueeze(-1) * X, torch.diag(root).expand(X.shape[0], -1, -1)], dim=1)
    aims = aims.expand(X.shape[0], 1, -1)
    return HeadProblem(rows, torch.cat([rows.transpose(1, 2), aims], dim=1), least)


def objective(slack: Tensor, least: Tensor) -> Tensor:
    """Compute the square root of J / C from (..., R) slack: (...)."""
    root: Tensor = torch.linalg.vector_norm(slack.maximum(least), dim=-1)
    return root


def newton_minimum(problem: HeadProblem, counts: Tensor) -> Tensor:
    """Minimise the quadratic piece of J in which the rows of ``counts`` are violated.

    Args:
        problem: the objective.
        counts: (B, 1, R) bool, the rows that count.

    Returns:
        (B, 1, D) weights.
    """
    D = problem.rows.shape[2]
    weighted = problem.columns_and_aims * counts.to(problem.rows.dtype)
    normal = weighted @ problem.rows  # (B, D + 1, D)
    minimum: Tensor = normal[:, D:] @ inverse(normal[:, :D])
    return minimum


def line_search(
    slack: Tensor, change: Tensor, least: Tensor, sizes: Tensor
) -> tuple[Tensor, Tensor]:
    """Find how far to go along Newton's direction.

    Args:
        slack: (B, 1, R) slack where it begins.
        change: (B, 1, R) by how much the whole step lowers the slack.
        least: (R,) as in `HeadProblem`.
        sizes: (S, 1, 1) lengths that are tried, the second of which is the whole step.

    Returns:
        size: (B, 1, 1) the best of these.
        moving: (B, 1) number of rows that the whole step makes violators, or no longer such; after
            a step that moves none, its end is the exact minimiser.
    """
    trials = slack - sizes[:, 0] * change  # (B, S, R)
    size = sizes.index_select(0, objective(trials, least).argmin(1))
    changed = (slack > least) ^ (trials[:, 1:2] > least)
    return size, changed.to(slack.dtype).sum(-1)


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
    problem = head_problem(X, y, C, ridge, prior)
    fixed = problem.detach()
    columns, most = fixed.columns, torch.tensor(MAX_STEPS, device=X.device)
    sizes = torch.tensor(STEP_SIZES, dtype=X.dtype, device=X.device).reshape(-1, 1, 1)  # (S, 1, 1)

    def goes_on(step: Tensor, w: Tensor, slack: Tensor, moving: Tensor) -> Tensor:
        return (step < most) & (moving.sum() > 0)

    def descend(
        step: Tensor, w: Tensor, slack: Tensor, moving: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        direction = newton_minimum(fixed, slack > fixed.least) - w
        change = direction @ columns
        size, moving = line_search(slack, change, fixed.least, sizes)
        return step + 1, w + size * direction, slack - size * change, moving

    w = prior.detach().expand(X.shape[0], 1, -1).clone()
    step, moving = torch.zeros((), dtype=torch.int64), torch.ones_like(w[..., 0])
    state = (step, w, fixed.slack(w).contiguous(), moving)
    _, w, slack, moving = repeat_while(goes_on, descend, state)
    if torch.compiler.is_exporting():
        return w.squeeze(1)  # the last step with gradients would be computed for nothing
    exact = newton_minimum(problem, slack > problem.least)
    return torch.where(moving.unsqueeze(-1) > 0, w, exact).squeeze(1)
