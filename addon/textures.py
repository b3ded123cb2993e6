# SPDX-License-Identifier: GPL-3.0-or-later
"""Image textures: pixels, and what a texture node makes of them at given places, as Cycles does."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import bpy

    Array = np.ndarray

#: Least share of its colour that a transparent pixel keeps, so that there is one where nothing is seen.
TRACE = 1 / 512
#: Colour spaces of byte images that need no conversion, and whose transparent pixels keep their colour.
_DATA = {"Non-Color", "Raw"}
_LINEAR = {*_DATA, "Linear Rec.709", "Linear"}


class MissingImage(Exception):
    """An image has no pixels; the text names it."""


class Image:
    """The pixels of an image, read once.

    size (2,) pixels; encoded: values are sRGB and become linear only once they are interpolated, as in Cycles
    """

    def __init__(self, image: bpy.types.Image) -> None:
        width, height = image.size
        if not width or not height or image.channels not in (1, 3, 4):
            raise MissingImage(f"image '{image.name}' is missing")
        pixels = np.empty(width * height * image.channels, np.float32)
        image.pixels.foreach_get(pixels)
        pixels = pixels.reshape(height, width, image.channels)
        self.size = np.array([width, height])
        space = image.colorspace_settings.name
        self.encoded = not image.is_float and space == "sRGB"
        self.strange_space = None if self.encoded or image.is_float or space in _LINEAR else space
        self._multiplied = image.alpha_mode in ("STRAIGHT", "PREMUL") and space not in _DATA
        self._pixels = np.ones((height, width, 4), np.float32)
        self._pixels[..., : image.channels] = pixels
        if image.channels == 1:
            self._pixels[..., :3] = pixels
        if image.alpha_mode == "NONE":
            self._pixels[..., 3] = 1.0
        if self._multiplied and not image.is_float:
            self._pixels[..., 3] = np.maximum(self._pixels[..., 3], TRACE)
            self._pixels[..., :3] *= self._pixels[..., 3:]

    def at(self, places: Array, interpolation: str, extension: str, with_alpha: bool) -> Array:
        """(S, 4) linear colour and alpha at places (S, 2), of which the image fills 0 to 1.

        with_alpha: alpha is asked for as well, so that colour is not to be multiplied by it.
        """
        x, y = (places[:, :2] * self.size).T
        if interpolation == "Closest":
            found = self._texels(np.floor(x), np.floor(y), extension)
        else:
            left, low = np.floor(x - 0.5), np.floor(y - 0.5)
            s, t = (x - 0.5 - left)[:, None], (y - 0.5 - low)[:, None]
            below = (1 - s) * self._texels(left, low, extension) + s * self._texels(left + 1, low, extension)
            above = (1 - s) * self._texels(left, low + 1, extension) + s * self._texels(left + 1, low + 1, extension)
            found = (1 - t) * below + t * above
        if with_alpha and self._multiplied:
            alpha = found[:, 3:]
            found[:, :3] /= np.where(alpha > 0, alpha, 1.0)
            alpha[alpha < 1.001 * TRACE] = 0.0
        if self.encoded:
            found[:, :3] = linear(found[:, :3])
        return found

    def _texels(self, x: Array, y: Array, extension: str) -> Array:
        (columns, inside_x), (rows, inside_y) = (
            _wrapped(places, size, extension) for places, size in zip((x, y), self.size.tolist(), strict=True)
        )
        found = self._pixels[rows, columns].astype(np.float64)
        found[~(inside_x & inside_y)] = 0.0
        return found


def box(places: Array, normals: Array, blend: float) -> list[tuple[Array, Array]]:
    """Weights (S,) and places (S, 2) on an image that is put on the sides of a box, for places and normals (S, 3) of a
    surface: it shows where the axis of a side is nearest to the normal; where others are about as near, within the
    share `blend`, they are mixed.
    """
    axes = np.abs(normals) / np.maximum(np.abs(normals).sum(axis=1, keepdims=True), 1e-30)
    limit = (1 + blend) / 2
    weights = np.zeros_like(axes)
    left = np.ones(len(axes), bool)
    for axis, (first, second) in enumerate(((1, 2), (0, 2), (0, 1))):
        alone = (axes[:, axis] > limit * (axes[:, axis] + axes[:, first])) & (
            axes[:, axis] > limit * (axes[:, axis] + axes[:, second])
        )
        weights[alone & left, axis] = 1.0
        left &= ~alone
    if blend == 0:
        weights[left, 0] = 1.0
        left[:] = False
    for axis, (first, second) in ((2, (0, 1)), (0, (1, 2)), (1, (0, 2))):
        two = left & (axes[:, axis] < (1 - limit) * (axes[:, first] + axes[:, second]))
        share = axes[two, first] / (axes[two, first] + axes[two, second])
        weights[two, first] = np.clip((share - 0.5 * (1 - blend)) / max(blend, 1e-30), 0.0, 1.0)
        weights[two, second] = 1 - weights[two, first]
        left &= ~two
    weights[left] = ((2 - limit) * axes[left] + limit - 1) / max(2 * limit - 1, 1e-30)
    x, y, z = np.broadcast_to(places, (len(axes), 3)).T
    sides = (normals[:, 0] < 0, y, z), (normals[:, 1] > 0, x, z), (normals[:, 2] > 0, y, x)
    return [
        (weight, np.column_stack([np.where(turned, 1 - u, u), v]))
        for weight, (turned, u, v) in zip(weights.T, sides, strict=True)
    ]


def _wrapped(places: Array, size: int, extension: str) -> tuple[Array, Array]:
    """(S,) pixels of whole places outside of the image, and whether there are any."""
    inside = np.isfinite(places)
    places = np.where(inside, np.clip(places, -(2**52), 2**52), 0).astype(np.int64)
    if extension == "REPEAT":
        return places % size, inside
    if extension == "MIRROR":
        places = places % (2 * size)
        return np.where(places < size, places, 2 * size - 1 - places), inside
    if extension == "CLIP":
        inside = inside & (places >= 0) & (places < size)
    return np.clip(places, 0, size - 1), inside


def linear(encoded: Array) -> Array:
    """Linear values of sRGB ones (IEC 61966-2-1)."""
    encoded = np.maximum(encoded, 0.0)
    return np.where(encoded < 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
