"""Checks of an ONNX file from a stranger, before onnxruntime sees it and without the onnx package.

An ONNX file is a protobuf message. A tensor in it may say that its values lie in another file, or
at an address of memory, and onnxruntime follows. So the message is walked here, every graph and
subgraph in it, and whatever does not keep its own values is refused.
"""

from collections.abc import Iterator

from link.errors import InputError

MODEL, TRAINING, FUNCTION, GRAPH, NODE, ATTRIBUTE, TENSOR, SPARSE = range(8)
"""Kinds of messages of an ONNX file that lead to tensors and nodes."""
CHILDREN: dict[int, dict[int, int]] = {
    MODEL: {7: GRAPH, 20: TRAINING, 25: FUNCTION},
    TRAINING: {1: GRAPH, 2: GRAPH},
    FUNCTION: {7: NODE, 11: ATTRIBUTE},
    GRAPH: {1: NODE, 5: TENSOR, 15: SPARSE},
    NODE: {5: ATTRIBUTE},
    ATTRIBUTE: {5: TENSOR, 6: GRAPH, 10: TENSOR, 11: GRAPH, 22: SPARSE, 23: SPARSE},
    TENSOR: {},
    SPARSE: {},
}
"""Numbers of the fields that hold messages of another kind, by the kind of message that has them
(onnx.proto)."""
EXTERNAL_DATA, DATA_LOCATION = 13, 14
"""Fields of a tensor that send the reader elsewhere for its values."""
OP_TYPE, DOMAIN = 4, 7
"""Fields of a node that name its operator, and the set of operators that it is from."""
DOMAINS = (b"", b"ai.onnx", b"com.microsoft")
"""Sets of operators that decoders are made of."""
MAX_NODES = 50_000
"""Largest number of nodes of a model, subgraphs included; the shipped decoder has 787."""
MAX_FIELDS = 500_000
"""Largest number of fields that are looked at; the shipped decoders have 9,000. More would take
seconds and, where each holds an empty message, gigabytes."""
VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5
"""Wire types of protobuf."""


def check_onnx_file(data: bytes) -> None:
    """Refuse a model that reads files, or uses what no decoder needs.

    Args:
        data: the bytes of an .onnx file.

    Raises:
        InputError: a tensor's values lie outside the file, a tensor is sparse, an operator is from
            an unknown set or works on text, there are too many nodes or fields, or it is no
            protobuf. The message does not name the file.
    """
    nodes = fields = 0
    waiting = [(MODEL, 0, len(data))]
    while waiting:
        kind, start, end = waiting.pop()
        if kind == NODE:
            nodes += 1
            if nodes > MAX_NODES:
                raise InputError(f"it has more than {MAX_NODES} nodes")
        elif kind == SPARSE:
            raise InputError("it holds sparse tensors")
        children = CHILDREN[kind]
        for field, first, last in _fields(data, start, end):
            fields += 1
            if fields > MAX_FIELDS:
                raise InputError(f"it has more than {MAX_FIELDS} fields")
            if field in children:
                waiting.append((children[field], first, last))
            elif kind == TENSOR and field in (EXTERNAL_DATA, DATA_LOCATION):
                if field == EXTERNAL_DATA or any(data[first:last]):
                    raise InputError("it takes values from another file (external data)")
            elif kind == NODE and field == DOMAIN and data[first:last] not in DOMAINS:
                raise InputError(f"it has operators from {_shown(data[first:last])}")
            elif kind == NODE and field == OP_TYPE and b"String" in data[first:last]:
                raise InputError(f"it has the operator {_shown(data[first:last])}")


def _shown(name: bytes) -> str:
    return repr(name.decode(errors="replace")[:40])


def _fields(data: bytes, start: int, end: int) -> Iterator[tuple[int, int, int]]:
    """The fields of a message: number, and the bytes from first to last (exclusive) it holds."""
    at = start
    while at < end:
        key, at = _varint(data, at)
        first, wire = at, key & 7
        if wire == BYTES:
            length, first = _varint(data, at)
            at = first + length
        elif wire == VARINT:
            _, at = _varint(data, at)
        elif wire in (FIXED64, FIXED32):
            at += 8 if wire == FIXED64 else 4
        else:
            raise InputError("it is no protobuf message")
        if at > end:
            raise InputError("it is cut off or damaged")
        yield key >> 3 & 0x1FFFFFFF, first, at


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """A number of variable length, and the place behind it."""
    value = shift = 0
    while shift < 70:
        if at >= len(data):
            raise InputError("it is cut off or damaged")
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
        shift += 7
    raise InputError("it is no protobuf message")
