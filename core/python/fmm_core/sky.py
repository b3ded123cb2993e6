# SPDX-License-Identifier: GPL-3.0-or-later
"""The sky: light from all around, of one colour or an image."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .arrays import LARGEST, numbers
from .errors import Error

Points = NDArray[np.float64]

#: Rows of the image that rays over the hemisphere look up: a ray stands for a few degrees.
ROWS = 64
#: What is brighter than so many times the mean, the bright parts cut off, is aimed at, like a lamp.
BRIGHT = 8.0
#: Cutting off changes the mean: so many times over.
ROUNDS = 4
#: Bright parts that bring less than this share of the light are not worth any aim.
LEAST_SHARE = 1e-3
#: Distributions that differ by less than this share are as good as each other to aim by.
SAME = 1e-3


@dataclass(frozen=True, eq=False)
class Sky:
    """Light from all around, from far away.

    radiance   W/(m^2 sr): one number, three for the colours, or an image (H, W, 3), in which rows run from +z down by
    angle, and columns from -x through +y, +x and -y
    Raises `Error` naming shape or value.
    """

    radiance: ArrayLike

    def __post_init__(self) -> None:
        radiance = numbers("sky", self.radiance)
        if radiance.ndim == 3 and radiance.shape[2] == 3 and radiance.size:
            pass
        elif radiance.shape in ((), (3,)):
            radiance = np.broadcast_to(radiance, (1, 1, 3)).copy()
        else:
            raise Error(f"sky: expected a number, three or an image (H, W, 3), got shape {radiance.shape}")
        wrong = ~((radiance >= 0) & (radiance <= LARGEST))
        if wrong.any():
            row, column, _ = np.argwhere(wrong)[0]
            raise Error(f"sky: row {row}, column {column} is {radiance[row, column].tolist()}")
        radiance.flags.writeable = False
        object.__setattr__(self, "radiance", radiance)

    @property
    def is_black(self) -> bool:
        """Whether it gives no light."""
        return not self.radiance.any()

    @property
    def is_even(self) -> bool:
        """Whether it is the same all around."""
        return self.radiance.shape[:2] == (1, 1)

    @cached_property
    def _parts(self) -> tuple[Points, "Bright | None"]:
        """The image less its bright parts, of few rows, and these."""
        if self.is_even or self.is_black:
            return self.radiance[:1, :1], None
        solid = _solid_angles(self.radiance.shape)
        brightness, limit = self.radiance.mean(axis=2), np.inf
        for _ in range(ROUNDS):
            limit = BRIGHT * (solid * np.minimum(brightness, limit)).sum() / solid.sum()
        kept = np.minimum(1.0, limit / np.maximum(brightness, limit))
        extra = (1 - kept)[..., None] * self.radiance
        if (solid[..., None] * extra).sum() <= LEAST_SHARE * (solid[..., None] * self.radiance).sum():
            return _reduced(self.radiance, solid), None
        return _reduced(self.radiance - extra, solid), Bright(solid[..., None] * extra)

    @property
    def bright(self) -> "Bright | None":
        """The parts of it that stand out, as far as they do."""
        return self._parts[1]

    def smooth(self, directions: Points) -> Points:
        """Radiance (..., 3) from unit directions (..., 3), of what does not stand out."""
        image = self._parts[0]
        if self.is_even:
            return np.broadcast_to(image[0, 0], directions.shape)
        rows, columns = image.shape[:2]
        y = np.arccos(np.clip(directions[..., 2], -1, 1)) * (rows / np.pi)
        x = (0.5 - np.arctan2(directions[..., 1], directions[..., 0]) / (2 * np.pi)) * columns
        return image[np.minimum(y.astype(int), rows - 1), np.minimum(x.astype(int), columns - 1)]


class Bright:
    """Bright parts of an image, to be aimed at: flux (H, W, 3), W/m^2, on a surface that faces each pixel."""

    def __init__(self, flux: Points) -> None:
        self.flux = flux
        brightness = flux.sum(axis=2)
        self._shares = brightness / brightness.sum()
        of_rows = self._shares.sum(axis=1)
        self._rows = np.cumsum(of_rows)
        within = np.cumsum(self._shares, axis=1) / np.where(of_rows > 0, of_rows, 1.0)[:, None]
        self._columns = (np.arange(len(of_rows))[:, None] + np.minimum(within, 1.0)).ravel()

    def serves(self, other: "Bright") -> bool:
        """Whether directions to these parts are as good for others."""
        same = self.flux.shape == other.flux.shape
        return same and bool(np.abs(self._shares - other._shares).sum() < SAME)

    def directions(self, pattern: Points) -> tuple[Points, NDArray[np.int64]]:
        """Unit directions (M, K, 3) from a pattern (M, K, 2) in the unit square, more to what is brighter, and the
        pixel (M, K) of each.
        """
        rows, columns = self.flux.shape[:2]
        row = np.minimum(np.searchsorted(self._rows, pattern[..., 0] * self._rows[-1], side="right"), rows - 1)
        pixel = np.searchsorted(self._columns, row + pattern[..., 1] * (1 - 1e-12), side="right")
        pixel = np.minimum(pixel, self._columns.size - 1)
        low = np.where(pixel % columns > 0, self._columns[pixel - 1], row)
        into = (row + pattern[..., 1] - low) / np.maximum(self._columns[pixel] - low, 1e-30)
        start = np.where(row > 0, self._rows[row - 1], 0.0)
        down = (pattern[..., 0] * self._rows[-1] - start) / np.maximum(self._rows[row] - start, 1e-30)
        edges = np.cos(np.pi * np.arange(rows + 1) / rows)
        z = edges[row] + np.clip(down, 0, 1) * (edges[row + 1] - edges[row])
        phi = np.pi - 2 * np.pi * (pixel % columns + np.clip(into, 0, 1)) / columns
        sine = np.sqrt(np.maximum(1 - z**2, 0.0))
        return np.stack([sine * np.cos(phi), sine * np.sin(phi), z], axis=2), pixel

    def weights(self, pixels: NDArray[np.int64], bright: "Bright") -> Points:
        """(M, K, 3) what light of other bright parts comes by directions that were made for these."""
        shares = self._shares.ravel()[pixels]
        return bright.flux.reshape(-1, 3)[pixels] / (pixels.shape[1] * shares[..., None])


def _solid_angles(shape: tuple[int, ...]) -> Points:
    """(H, W) of the pixels of an image."""
    edges = np.cos(np.pi * np.arange(shape[0] + 1) / shape[0])
    return np.repeat((edges[:-1] - edges[1:])[:, None] * 2 * np.pi / shape[1], shape[1], axis=1)


def _reduced(image: Points, solid: Points) -> Points:
    """Means over blocks of pixels, so that at most `ROWS` rows and twice as many columns are left."""
    rows, columns = min(ROWS, image.shape[0]), min(2 * ROWS, image.shape[1])
    starts = [np.arange(n) * full // n for n, full in ((rows, image.shape[0]), (columns, image.shape[1]))]

    def summed(values: Points) -> Points:
        return np.add.reduceat(np.add.reduceat(values, starts[0], axis=0), starts[1], axis=1)

    return summed(solid[..., None] * image) / summed(solid)[..., None]
