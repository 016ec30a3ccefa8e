"""The places of the blocks and wires of a diagram, in CSS pixels.

Above, from left to right, what drives: signal, controller, limits, and the device in its frame. Below, from left to right
again, what is seen: recorder, counts to angle, the stages, the scope, and the identification under it. Samples go from one to
the other on a line between the two rows, from which a controller that follows them takes its feedback.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, TypeAlias

from servobench.panel.diagram import Block, Diagram, Wire

Point: TypeAlias = tuple[float, float]

HEIGHT = 76.0  # of a block
_NARROWEST = 104.0
_GAP = 46.0  # between blocks, for an arrow and its label
_PAD = 16.0  # between the device's frame and what is in it
_CAPTION = 18.0  # above a block, for its kind
_LINE = 22.0  # between two lines side by side
_OUT = 48.0  # from the frame to where the samples go down
_MARGIN = 8.0
_TITLE_LETTER, _SYMBOL_LETTER = 7.4, 8.4  # widths at the sizes of the style sheet, on the wide side
_MARKUP = re.compile(r"[_^]\{([^}]*)\}")


@dataclass(frozen=True, kw_only=True)
class Box:
    """A rectangle by its upper left corner x, y (downwards), its width and its height, all in the drawing's units: CSS pixels."""

    x: float
    y: float
    width: float
    height: float = HEIGHT

    @property
    def right(self) -> float:
        """The right edge."""
        return self.x + self.width

    @property
    def bottom(self) -> float:
        """The lower edge."""
        return self.y + self.height

    @property
    def middle(self) -> Point:
        """Its centre."""
        return self.x + self.width / 2, self.y + self.height / 2


@dataclass(frozen=True, kw_only=True)
class Path:
    """The course of a wire: its corners are `points`, its label stands `at` one, and with a `joint` it branches off another."""

    points: tuple[Point, ...]
    at: Point
    joint: bool = False


@dataclass(frozen=True, kw_only=True)
class Placement:
    """Boxes of the blocks by id, paths of the wires in their order, the frame of the device, width and height of it all."""

    boxes: dict[str, Box]
    paths: tuple[Path, ...]
    frame: Box
    width: float
    height: float


def drawing(diagram: Diagram) -> dict[str, Any]:
    """Return a diagram with its placement as plain data for JSON, as the page draws it."""
    placed = placement(diagram)
    return {
        "width": placed.width,
        "height": placed.height,
        "device": {"title": diagram.device, **asdict(placed.frame)},
        "blocks": [{**asdict(block), **asdict(placed.boxes[block.id])} for block in diagram.blocks],
        "wires": [
            {"from": wire.source, "to": wire.target, "label": wire.label, **asdict(path)}
            for wire, path in zip(diagram.wires, placed.paths, strict=True)
        ],
    }


def placement(diagram: Diagram) -> Placement:
    """Return where everything stands: no two blocks touch, and a wire begins and ends at the edge of its blocks."""
    boxes, frame = _motor_row(diagram)
    lines = frame.bottom + _LINE + 4
    boxes |= _sensor_row(diagram, lines + _LINE + _CAPTION + 24)
    paths = tuple(_path(wire, boxes, frame, lines) for wire in diagram.wires)
    right = max(box.right for box in (*boxes.values(), frame)) + _OUT
    bottom = max(box.bottom for box in boxes.values())
    return Placement(boxes=boxes, paths=paths, frame=frame, width=right + _MARGIN, height=bottom + _MARGIN)


def _width(block: Block) -> float:
    """The width that a block's text needs."""
    symbol = max((len(_MARKUP.sub(r"\1", text)) for text in block.symbol), default=0)
    return max(_NARROWEST, _TITLE_LETTER * len(block.title) + 22, _SYMBOL_LETTER * symbol + 24)


def _row(blocks: Sequence[Block], x: float, y: float) -> dict[str, Box]:
    boxes = {}
    for block in blocks:
        boxes[block.id] = Box(x=x, y=y, width=_width(block))
        x = boxes[block.id].right + _GAP
    return boxes


def _motor_row(diagram: Diagram) -> tuple[dict[str, Box], Box]:
    """The upper row, with sensors beside the encoder under the motor, and the device's frame."""
    drive = [block for block in diagram.blocks if block.kind in {"signal", "controller", "limits"}]
    device = [block for block in diagram.blocks if block.kind in {"device", "motor"} or block.id == "encoder"]
    others = [block for block in diagram.blocks if block.kind == "sensor" and block.id != "encoder"]
    y = _MARGIN + 2 * _CAPTION + 4
    boxes = _row(drive, _MARGIN, y)
    left = max(box.right for box in boxes.values()) + _GAP
    boxes |= _row(device, left + _PAD, y)
    # Straight below the motor, which is what the first of them measures.
    first = boxes["motor"].middle[0] - _width(others[0]) / 2 if others else 0.0
    boxes |= _row(others, first, y + HEIGHT + _GAP)
    held = [boxes[block.id] for block in (*device, *others)]
    right, bottom = max(box.right for box in held), max(box.bottom for box in held)
    top = _MARGIN
    frame = Box(x=left, y=top, width=right + _PAD - left, height=bottom + _PAD - top)
    return boxes, frame


def _sensor_row(diagram: Diagram, y: float) -> dict[str, Box]:
    """The lower row, and the identification under the scope."""
    row = [b for b in diagram.blocks if b.kind in {"recorder", "stage", "conversion", "scope"}]
    last = next(block for block in diagram.blocks if block.id == "identification")
    boxes = _row(row, _MARGIN, y)
    boxes["identification"] = Box(x=boxes["scope"].x, y=y + HEIGHT + _GAP, width=_width(last))
    return boxes


def _path(wire: Wire, boxes: dict[str, Box], frame: Box, lines: float) -> Path:
    """The course of a wire; samples run on a line at height `lines`, voltages on one below it."""
    a, b = boxes[wire.source], boxes[wire.target]
    if wire.target == "recorder":
        return _to_the_recorder(wire, a, b, frame, lines)
    if wire.target == "controller" and b.x > a.x:
        return _straight(a, b)
    if wire.target == "controller":
        x, bottom = b.middle[0], b.bottom
        return Path(points=((x, lines), (x, bottom)), at=(x + 10, bottom + 20), joint=True)
    if wire.target == "identification":
        return _to_the_identification(wire, a, b, boxes["scope"])
    if a.y == b.y:
        return _straight(a, b)
    return _down(a, b)


def _straight(a: Box, b: Box) -> Path:
    y = a.middle[1]
    return Path(points=((a.right, y), (b.x, y)), at=((a.right + b.x) / 2 - 2, y - 8))


def _down(a: Box, b: Box) -> Path:
    """From the bottom of a block to the top of one that stands below it, or below and to the right."""
    x, halfway = a.middle[0], (a.bottom + b.y) / 2 - 6
    target = b.middle[0]
    corners: tuple[Point, ...] = ((x, a.bottom), (x, halfway), (target, halfway), (target, b.y))
    if abs(x - target) < 1:
        corners = ((x, a.bottom), (x, b.y))
    return Path(points=corners, at=(target + 10, b.y - 26))


def _to_the_recorder(wire: Wire, a: Box, b: Box, frame: Box, lines: float) -> Path:
    if wire.source == "limits":  # the voltage, taken off the wire to the device
        tap, y, end = a.right + 16, lines + _LINE, b.x + 0.7 * b.width
        points: tuple[Point, ...] = ((tap, a.middle[1]), (tap, y), (end, y), (end, b.y))
        return Path(points=points, at=(end + 34, y + 16), joint=True)
    end = b.x + 0.3 * b.width
    if wire.source == "encoder":
        out = frame.right + _OUT
        points = ((a.right, a.middle[1]), (out, a.middle[1]), (out, lines), (end, lines), (end, b.y))
        return Path(points=points, at=((frame.right + out) / 2, a.middle[1] - 8))
    x = a.middle[0]
    return Path(points=((x, a.bottom), (x, lines), (end, lines), (end, b.y)), at=(x + 34, lines - 8))


def _to_the_identification(wire: Wire, a: Box, b: Box, scope: Box) -> Path:
    if wire.source == "recorder":
        x, y = a.middle[0], b.y + 0.72 * b.height
        return Path(points=((x, a.bottom), (x, y), (b.x, y)), at=(b.x - 20, y - 8))
    x, y = scope.x - 28, b.y + 0.28 * b.height
    return Path(points=((x, a.middle[1]), (x, y), (b.x, y)), at=(b.x - 16, y - 8), joint=True)
