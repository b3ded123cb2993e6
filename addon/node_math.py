# SPDX-License-Identifier: GPL-3.0-or-later
"""The arithmetic of shader nodes on arrays: operations, blending, curves. Names are Blender's."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Array = np.ndarray

#: Rec. 709 weights by which colours become grey.
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def _safe(a: Array, b: Array, make: Callable[[Array, Array], Array]) -> Array:
    return np.where(b != 0, make(a, np.where(b != 0, b, 1.0)), 0.0)


def _power(a: Array, b: Array) -> Array:
    whole = b == np.rint(b)
    return np.where((a >= 0) | whole, np.power(np.where((a >= 0) | whole, a, 1.0), b), 0.0)


def _wrap(a: Array, b: Array, c: Array) -> Array:
    return np.where(b != c, a - (b - c) * np.floor(_safe(a - c, b - c, np.divide)), c)


def _pingpong(a: Array, b: Array) -> Array:
    return np.where(b != 0, np.abs(np.mod(_safe(a - b, 2 * b, np.divide), 1.0) * 2 * b - b), 0.0)


def _smooth(sign: float) -> Callable[..., Array]:
    def smooth(a: Array, b: Array, c: Array) -> Array:
        h = np.maximum(np.where(c != 0, c, 1.0) - np.abs(a - b), 0.0) / np.where(c != 0, c, 1.0)
        least = np.minimum(sign * a, sign * b)
        return sign * np.where(c != 0, least - h**3 * c / 6, least)

    return smooth


#: Of the Math node; each takes three values.
OPERATIONS: dict[str, Callable[[Array, Array, Array], Array]] = {
    "ADD": lambda a, b, c: a + b,
    "SUBTRACT": lambda a, b, c: a - b,
    "MULTIPLY": lambda a, b, c: a * b,
    "DIVIDE": lambda a, b, c: _safe(a, b, np.divide),
    "MULTIPLY_ADD": lambda a, b, c: a * b + c,
    "POWER": lambda a, b, c: _power(a, b),
    "LOGARITHM": lambda a, b, c: np.where((a > 0) & (b > 0), np.log(np.maximum(a, 1e-300))
                                          / np.where(b == 1, np.inf, np.log(np.maximum(b, 1e-300))), 0.0),
    "SQRT": lambda a, b, c: np.sqrt(np.maximum(a, 0.0)),
    "INVERSE_SQRT": lambda a, b, c: _safe(np.ones_like(a), np.sqrt(np.maximum(a, 0.0)), np.divide),
    "ABSOLUTE": lambda a, b, c: np.abs(a),
    "EXPONENT": lambda a, b, c: np.exp(np.minimum(a, 700.0)),
    "MINIMUM": lambda a, b, c: np.minimum(a, b),
    "MAXIMUM": lambda a, b, c: np.maximum(a, b),
    "LESS_THAN": lambda a, b, c: (a < b).astype(float),
    "GREATER_THAN": lambda a, b, c: (a > b).astype(float),
    "SIGN": lambda a, b, c: np.sign(a),
    "COMPARE": lambda a, b, c: (np.abs(a - b) <= np.maximum(c, 1e-5)).astype(float),
    "SMOOTH_MIN": _smooth(1.0),
    "SMOOTH_MAX": _smooth(-1.0),
    "ROUND": lambda a, b, c: np.floor(a + 0.5),
    "FLOOR": lambda a, b, c: np.floor(a),
    "CEIL": lambda a, b, c: np.ceil(a),
    "TRUNC": lambda a, b, c: np.trunc(a),
    "FRACT": lambda a, b, c: a - np.floor(a),
    "MODULO": lambda a, b, c: _safe(a, b, np.fmod),
    "FLOORED_MODULO": lambda a, b, c: _safe(a, b, np.mod),
    "WRAP": _wrap,
    "SNAP": lambda a, b, c: np.floor(_safe(a, b, np.divide)) * b,
    "PINGPONG": lambda a, b, c: _pingpong(a, b),
    "SINE": lambda a, b, c: np.sin(a),
    "COSINE": lambda a, b, c: np.cos(a),
    "TANGENT": lambda a, b, c: np.tan(a),
    "ARCSINE": lambda a, b, c: np.arcsin(np.clip(a, -1, 1)),
    "ARCCOSINE": lambda a, b, c: np.arccos(np.clip(a, -1, 1)),
    "ARCTANGENT": lambda a, b, c: np.arctan(a),
    "ARCTAN2": lambda a, b, c: np.arctan2(a, b),
    "SINH": lambda a, b, c: np.sinh(np.clip(a, -700, 700)),
    "COSH": lambda a, b, c: np.cosh(np.clip(a, -700, 700)),
    "TANH": lambda a, b, c: np.tanh(a),
    "RADIANS": lambda a, b, c: np.radians(a),
    "DEGREES": lambda a, b, c: np.degrees(a),
}  # fmt: skip

#: Of the Vector Math node, where the answer is a vector made component by component.
VECTOR_OPERATIONS = {
    "ADD", "SUBTRACT", "MULTIPLY", "DIVIDE", "MULTIPLY_ADD", "ABSOLUTE", "MINIMUM", "MAXIMUM", "FLOOR", "CEIL",
    "MODULO", "WRAP", "SNAP", "SINE", "COSINE", "TANGENT",
}  # fmt: skip


def _overlay(a: Array, b: Array) -> Array:
    return np.where(a < 0.5, 2 * a * b, 1 - 2 * (1 - a) * (1 - b))


def _dodge(a: Array, b: Array) -> Array:
    free = np.where(b < 1, 1 - b, 1.0)
    return np.where(a == 0, 0.0, np.where(b < 1, np.minimum(a / free, 1.0), 1.0))


def _burn(a: Array, b: Array) -> Array:
    return np.where(b > 0, np.clip(1 - (1 - a) / np.where(b > 0, b, 1.0), 0.0, 1.0), 0.0)


#: What a Mix node makes of two colours at a factor of 1; those that are not here mix hues.
_BLENDS: dict[str, Callable[[Array, Array], Array]] = {
    "MIX": lambda a, b: b,
    "ADD": lambda a, b: a + b,
    "MULTIPLY": lambda a, b: a * b,
    "SUBTRACT": lambda a, b: a - b,
    "SCREEN": lambda a, b: 1 - (1 - a) * (1 - b),
    "DIVIDE": lambda a, b: np.where(b != 0, a / np.where(b != 0, b, 1.0), a),
    "DIFFERENCE": lambda a, b: np.abs(a - b),
    "EXCLUSION": lambda a, b: np.maximum(a + b - 2 * a * b, 0.0),
    "DARKEN": np.minimum,
    "LIGHTEN": np.maximum,
    "OVERLAY": _overlay,
    "SOFT_LIGHT": lambda a, b: (1 - a) * b * a + a * (1 - (1 - a) * (1 - b)),
    "LINEAR_LIGHT": lambda a, b: a + 2 * b - 1,
}


def blend(kind: str, factor: Array, a: Array, b: Array) -> Array | None:
    """Two colours mixed by a factor that has as many columns, or one; None where this blending is not known."""
    if kind == "DODGE":
        return _dodge(a, factor * b)
    if kind == "BURN":
        return _burn(a, 1 - factor + factor * b)
    if kind not in _BLENDS:
        return None
    return (1 - factor) * a + factor * _BLENDS[kind](a, b)


def rgb_to_hsv(colours: Array) -> Array:
    """Hue, saturation and value (S, 3), all from 0 to 1 for colours from 0 to 1."""
    most, least = colours.max(axis=1), colours.min(axis=1)
    delta = most - least
    safe = np.where(delta > 0, delta, 1.0)
    red, green, blue = ((most[:, None] - colours) / safe[:, None]).T
    hue = np.where(
        colours[:, 0] == most, blue - green, np.where(colours[:, 1] == most, 2 + red - blue, 4 + green - red)
    )
    hue = np.where(delta > 0, hue / 6 % 1.0, 0.0)
    return np.column_stack([hue, np.where(most > 0, delta / np.where(most > 0, most, 1.0), 0.0), most])


def hsv_to_rgb(colours: Array) -> Array:
    """Colours (S, 3) of hue, saturation and value."""
    hue, saturation, value = colours.T
    ramp = np.abs((hue[:, None] * 6 + [0.0, 4.0, 2.0]) % 6 - 3) - 1
    return value[:, None] * (1 - saturation[:, None] * (1 - np.clip(ramp, 0.0, 1.0)))


def mapped(kind: str, vector: Array, shift: Array, turned: Array, scale: Array) -> Array:
    """Vectors (S, 3), scaled, turned by matrices (S, 3, 3) and shifted as a node Mapping of this kind does."""
    if kind == "TEXTURE":
        back = (turned.swapaxes(1, 2) @ (vector - shift)[..., None])[..., 0]
        return back / np.where(scale != 0, scale, np.inf)
    if kind == "NORMAL":
        found = (turned @ (vector / np.where(scale != 0, scale, np.inf))[..., None])[..., 0]
        length = np.linalg.norm(found, axis=1, keepdims=True)
        return found / np.where(length > 0, length, 1.0)
    found = (turned @ (vector * scale)[..., None])[..., 0]
    return found + shift if kind == "POINT" else found


def rotation(angles: Array) -> Array:
    """(S, 3, 3) matrices of Euler angles (S, 3) about x, then y, then z."""
    (sx, sy, sz), (cx, cy, cz) = np.sin(angles).T, np.cos(angles).T
    rows = [
        [cy * cz, sy * sx * cz - cx * sz, sy * cx * cz + sx * sz],
        [cy * sz, sy * sx * sz + cx * cz, sy * cx * sz - sx * cz],
        [-sy, cy * sx, cy * cx],
    ]
    return np.moveaxis(np.array(rows), 2, 0)
