"""What the torch decoders write differently so that onnxruntime runs them, and runs them quickly.

Everything in this module computes what a plain expression of torch would. Each function says why
that expression does not serve. `export.to_onnx` translates the custom operators.
"""

from __future__ import annotations  # export cannot trace those of inner functions

from collections.abc import Callable
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch._higher_order_ops.scan import scan as exported_scan
from torch.nn.functional import conv2d, pad

State = tuple[Tensor, ...]
"""Tensors that an iteration passes from step to step; shapes and dtypes stay."""


@torch.library.custom_op("camera_display::inverse", mutates_args=())
def exported_inverse(A: Tensor) -> Tensor:
    """Invert (B, D, D) matrices; `export.to_onnx` makes onnxruntime's Inverse of this."""
    inverted: Tensor = torch.linalg.inv(A)
    return inverted


@exported_inverse.register_fake
def _(A: Tensor) -> Tensor:
    return torch.empty_like(A)


def inverse(A: Tensor) -> Tensor:
    """Invert (B, D, D) matrices, differentiably; the result has the same shape.

    torch.linalg does not export, and elimination written in ONNX took 6 ms.
    """
    operation = exported_inverse if torch.compiler.is_exporting() else torch.linalg.inv
    inverted: Tensor = operation(A)
    return inverted


def inverse_of_one(A: Tensor) -> Tensor:
    """Invert one (D, D) matrix in float64, in which torch and onnxruntime agree; gives float32."""
    return inverse(A.double().unsqueeze(0))[0].float()


@torch.library.custom_op("camera_display::sum_pixels", mutates_args=())
def exported_sum(frame: Tensor, weights: Tensor, stride: int) -> Tensor:
    """Sum weighted uint8 pixels; `export.to_onnx` makes ONNX's ConvInteger of this."""
    return conv2d(frame.float(), weights.float(), stride=stride)


@exported_sum.register_fake
def _(frame: Tensor, weights: Tensor, stride: int) -> Tensor:
    return conv2d(frame.float(), weights.float(), stride=stride)


def sum_pixels(frame: Tensor, weights: Tensor, stride: int, whole: bool) -> Tensor:
    """Sum weighted pixels over squares: a convolution whose stride is the side of its kernel.

    onnxruntime adds up uint8 pixels as they are where weights are whole numbers, without a float
    copy of the frame.

    Args:
        frame: (B, 3, H, W) uint8, or float.
        weights: (C, 3, stride, stride) float32, none negative: signed weights would be added up
            with saturation on some processors.
        stride: side of the squares, in pixels.
        whole: whether all weights are whole numbers below 256.

    Returns:
        (B, C, H // stride, W // stride) float32.
    """
    if torch.compiler.is_exporting() and whole:
        total: Tensor = exported_sum(frame, weights.to(torch.uint8), stride)
        return total
    return conv2d(frame.float(), weights, stride=stride)


def repeat_while(goes_on: Callable[..., Tensor], step: Callable[..., State], state: State) -> State:
    """Repeat a step while a condition holds; without gradients.

    A loop of Python would be unrolled on export, each step with all its nodes; torch's own becomes
    one Loop of ONNX.

    Args:
        goes_on: tells by the state, as a () bool tensor, whether another step is due.
        step: makes the next state of a state.
        state: first state.

    Returns:
        the last state.
    """
    with torch.no_grad():
        if torch.compiler.is_exporting():
            last: State = torch.while_loop(goes_on, step, state)  # type: ignore[no-untyped-call]
            return last
        while goes_on(*state):
            state = step(*state)
        return state


def repeat(count: int, step: Callable[..., State], state: State) -> State:
    """Repeat a step a number of times, with gradients.

    Export makes one Loop of ONNX of it, as of `repeat_while`, in place of each step's own nodes.

    Args:
        count: number of steps.
        step: makes the next state of a state.
        state: first state.

    Returns:
        the last state.

    >>> repeat(3, lambda x: (2 * x,), (torch.ones(()),))
    (tensor(8.),)
    """
    if torch.compiler.is_exporting():

        def body(number: Tensor, *now: Tensor) -> State:
            return (number + 1, *step(*now))

        first = torch.zeros((), dtype=torch.int64)
        last: State = torch.while_loop(  # type: ignore[no-untyped-call]
            lambda number, *_: number < count, body, (first, *state)
        )
        return last[1:]
    for _ in range(count):
        state = step(*state)
    return state


def scan(
    step: Callable[..., State],
    start: Tensor | State,
    *inputs: Tensor,
    reverse: bool = False,
) -> State:
    """Go through tensors along axis 0, and pass a state from each step to the next.

    A loop of Python would be unrolled on export, and needs the number of steps; torch's own becomes
    one Scan of ONNX. It has no gradients to speak of, so training takes the loop.

    Args:
        step: takes the state's tensors and a slice of each input, and returns the next state's
            tensors and then the outputs; no two of these may be the same tensor.
        start: tensor or tensors of the first state.
        inputs: tensors of the same length along axis 0.
        reverse: whether to begin with the last slice; outputs stay in the order of inputs.

    Returns:
        the outputs, stacked along axis 0.

    >>> (sums,) = scan(lambda s, x: (s + x, s + x), torch.zeros(()), torch.arange(4.0))
    >>> sums.tolist()
    [0.0, 1.0, 3.0, 6.0]
    """
    state = start if isinstance(start, tuple) else (start,)
    size = len(state)
    if torch.compiler.is_exporting():

        def body(carried: State, slices: State) -> tuple[State, State]:
            results = step(*carried, *slices)
            return results[:size], results[size:]

        outputs: State = exported_scan(body, state, inputs, reverse=reverse)[1]
        return outputs
    # unbind, because the gradient of each slice on its own would be as large as the input
    slices = list(zip(*(each.unbind() for each in inputs), strict=True))
    rows = []
    for now in reversed(slices) if reverse else slices:
        results = step(*state, *now)
        state = results[:size]
        rows.append(results[size:])
    return tuple(torch.stack(row) for row in zip(*(rows[::-1] if reverse else rows), strict=True))


def table(values: NDArray[Any]) -> Tensor:
    """Make a tensor that moves with its module to other devices, but is not saved with it.

    Whole numbers by which positions are worked out are float64 where that is so: onnxruntime
    divides and rounds them down quickest.
    """
    return nn.Buffer(torch.from_numpy(values), persistent=False)


def column_sum(columns: Tensor) -> Tensor:
    """Add up (B, K, R) over K: (B, 1, R), as a product, which onnxruntime does quickest."""
    return columns.new_ones((1, columns.shape[1])) @ columns


def times_vector(matrices: Tensor, vector: Tensor) -> Tensor:
    """Multiply (B, R, K) by a vector (K,): (B, R, 1).

    The vector is a matrix of one column: onnxruntime 1.31 gets a transposed matrix times a vector
    wrong.
    """
    return matrices @ vector.unsqueeze(-1)


def softplus(x: Tensor) -> Tensor:
    """Compute log(1 + exp(x)), of operations that onnxruntime has for float64."""
    return x.relu() + (1 + (-x.abs()).exp()).log()


def average_squares(image: Tensor, k: int) -> Tensor:
    """Average (B, 1, H, W) over squares of k x k pixels: (B, 1, H // k, W // k).

    It is a convolution because onnxruntime's pooling is slow.
    """
    return conv2d(image, image.new_full((1, 1, k, k), 1 / k**2), stride=k)


def sample_bilinear(image: Tensor, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Sample images bilinearly at any positions; beyond the edges the outermost pixels repeat.

    It gathers the four neighbours of each position, in which onnxruntime is several times as quick
    as in its GridSample.

    Args:
        image: (B, C, H, W) intensities.
        x: columns, in pixels, that broadcast with ``y`` to (B, 1, H, W).
        y: rows, in pixels.

    Returns:
        values: (B, C, H, W) image(x, y).
        f_x: how far each column lies beyond the one to its left, in [0, 1), in the shape of ``x``.
        f_y: how far each row lies below the one above it, in [0, 1), in the shape of ``y``.
    """
    height, width = image.shape[-2:]
    left, top = x.floor(), y.floor()
    f_x, f_y = x - left, y - top
    # in the padded image the first column is -1; a position beyond lies between two equal pixels
    column, row = (left.clamp(-1, width - 1) + 1).int(), (top.clamp(-1, height - 1) + 1).int()
    flat = pad(image, (1, 1, 1, 1), mode="replicate").flatten(2)
    first = (row * (width + 2) + column).long().flatten(2)
    if image.shape[1] > 1:
        first = first.expand(-1, image.shape[1], -1)
    corners = (flat[..., k:].gather(2, first) for k in (0, 1, width + 2, width + 3))
    a, b, c, d = (corner.reshape(-1, *image.shape[1:]) for corner in corners)
    upper, lower = a + f_x * (b - a), c + f_x * (d - c)
    return upper + f_y * (lower - upper), f_x, f_y
