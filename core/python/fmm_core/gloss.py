# SPDX-License-Identifier: GPL-3.0-or-later
"""Gloss: light that surfaces reflect towards an eye, by tables of their reflection (`brdf.py`)."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .arrays import numbers, unit_rows
from .brdf import LEAST_ROUGHNESS, Brdf
from .errors import Error

Points = NDArray[np.float64]

#: Places whose roughness and level are others have tables of their own, as long as there are no more than so many;
MOST_TABLES = 32
#: else these are rounded to such steps.
ROUGHNESS_STEP, LEVEL_STEP = 1 / 32, 1 / 100
#: Cosines with the eye's direction below which nothing is seen of a front.
LEAST_COSINE = 0.01


@dataclass(frozen=True)
class Gloss:
    """How M places reflect light towards an eye.

    towards    (M, 3) directions to the eye, made unit length
    diffuse    (M, 3) what reflects to all sides
    facing     (M, 3) what microfacets reflect of light from straight ahead (F0), as of metal
    grazing    (M, 3) and along them (F90)
    plastic    (M, 3) colour of the reflection at a clear layer, usually 0 or 1
    level      (M,) share of the light from straight ahead that this layer reflects
    roughness  (M,) of both, its square being alpha; at least `LEAST_ROUGHNESS`
    measured   (M,) which of `tables` is used instead, with `facing` for its albedo; -1 for none
    Raises `Error` naming the array and its shape or value.
    """

    towards: ArrayLike
    diffuse: ArrayLike
    facing: ArrayLike = 0.0
    grazing: ArrayLike = 0.0
    plastic: ArrayLike = 0.0
    level: ArrayLike = 0.04
    roughness: ArrayLike = 0.5
    measured: ArrayLike = -1
    tables: tuple[Brdf, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "towards", unit_rows("towards", self.towards))
        count = len(self.towards)
        shapes = dict.fromkeys(("diffuse", "facing", "grazing", "plastic"), (count, 3))
        shapes |= dict.fromkeys(("level", "roughness", "measured"), (count,))
        for name, shape in shapes.items():
            values = numbers(name, getattr(self, name))
            try:
                values = np.broadcast_to(values, shape)
            except ValueError:
                raise Error(f"{name}: expected shape {shape} or a constant, got {values.shape}") from None
            if not (np.isfinite(values) & ((values >= 0) | (name == "measured"))).all():
                raise Error(f"{name}: expected finite numbers that are not negative, the least is {values.min():g}")
            object.__setattr__(self, name, values)
        object.__setattr__(self, "measured", self.measured.astype(np.int64))
        object.__setattr__(self, "level", np.minimum(self.level, 0.99))
        object.__setattr__(self, "roughness", np.clip(self.roughness, LEAST_ROUGHNESS, 1.0))
        if count and self.measured.max() >= len(self.tables):
            raise Error(f"measured: expected less than {len(self.tables)}, got {self.measured.max()}")

    @property
    def colour(self) -> Points:
        """(M, 3) albedo as it looks without gloss."""
        return self.diffuse + self.facing

    def shines(self, normals: Points) -> NDArray[np.bool_]:
        """(M,) which places have gloss that is seen: not those of backs."""
        layers = (self.plastic.max(axis=1) * self.level > 0) | (self.measured >= 0)
        shines = layers | (self.facing.max(axis=1) > 0) | (self.grazing.max(axis=1) > 0)
        return shines & ((self.towards * normals).sum(axis=1) > LEAST_COSINE)

    def of(self, rows: NDArray[np.int64]) -> "Gloss":
        """That of some of the places."""
        names = ("towards", "diffuse", "facing", "grazing", "plastic", "level", "roughness", "measured")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    def by_table(self) -> Iterator[tuple[NDArray[np.int64], Brdf]]:
        """The places of each table in turn, with the table."""
        for number, table in enumerate(self.tables):
            rows = np.flatnonzero(self.measured == number)
            if len(rows):
                yield rows, table
        made = np.flatnonzero(self.measured < 0)
        level = np.where(self.plastic[made].max(axis=1, initial=0.0) > 0, self.level[made], 0.0)
        kinds = np.round(np.column_stack([self.roughness[made], level]), 4)
        found, kind = np.unique(kinds, axis=0, return_inverse=True)
        if len(found) > MOST_TABLES:
            steps = [ROUGHNESS_STEP, LEVEL_STEP]
            found, kind = np.unique(np.round(kinds / steps) * steps, axis=0, return_inverse=True)
        for number, (roughness, level) in enumerate(found.tolist()):
            yield made[kind.reshape(-1) == number], Brdf.ggx(roughness, level)

    def radiance(self, table: Brdf, normals: Points, irradiance: Points, lobes: Points) -> Points:
        """(M, 3) W/(m^2 sr) towards the eye from places of one table.

        irradiance (M, 3) W/m^2; lobes (M, L, 3) what each lobe of the table sends with a weight of 1.

        The clear layer lets through what it does not reflect to the eye. Light that microfacets would send on to each
        other is added as Turquin has it (Practical multiple scattering compensation for microfacet models, 2019), with
        the mean over many bounces of Kulla and Conty (2017), so that white metal reflects all.
        """
        if (self.measured >= 0).all():
            # Its lobes are the colours.
            return self.diffuse * irradiance / np.pi + np.einsum("mcc->mc", lobes)
        weights = np.stack([self.facing, self.grazing, self.plastic], axis=1)
        albedo, mean = table.albedo((self.towards * normals).sum(axis=1)), table.mean_albedo
        perfect, all_sides = albedo[:, :2].sum(axis=1)[:, None], mean[:2].sum()
        fresnel = np.minimum(np.einsum("l,mlc->mc", mean, weights) / all_sides, 1.0)
        again = fresnel * all_sides / (1 - fresnel * (1 - all_sides))
        kept = 1 - np.minimum(albedo[:, 2:] * self.plastic, 1.0).max(axis=1, keepdims=True)
        shine = (weights * lobes).sum(axis=1) * (1 + again * (1 - perfect) / perfect)
        return self.diffuse * kept * irradiance / np.pi + shine


class Shine:
    """The response (`incident.py`) whose outputs are what each lobe of a table sends towards the eye."""

    def __init__(self, table: Brdf, towards: Points, normals: Points) -> None:
        """towards, normals: (M, 3), unit."""
        self.outputs = table.lobes
        self._table, self._towards, self._normals = table, towards, normals

    def directions(self, rows: slice, shifts: Points, count: int) -> Points:
        """More where the table sends more of it to the eye."""
        return self._table.directions(self._towards[rows], self._normals[rows], shifts, count)

    def density(self, rows: slice, directions: Points, count: int) -> Points:
        """As the table's."""
        return self._table.density(directions, self._towards[rows], self._normals[rows], count)

    def total(self, rows: slice, directions: Points, flux: Points) -> Points:
        """(R, L, 3) W/(m^2 sr) by each lobe."""
        found = np.zeros((len(flux), self.outputs, 3))
        row, k = np.nonzero(flux.any(axis=2))
        at, incoming = row + rows.start, directions[row, k]
        values = self._table.values(incoming, self._towards[at], self._normals[at])
        values *= np.maximum((incoming * self._normals[at]).sum(axis=1), 0.0)[:, None]
        for lobe in range(self.outputs):
            sent = values[:, lobe, None] * flux[row, k]
            found[:, lobe] = np.stack([np.bincount(row, colour, len(flux)) for colour in sent.T], axis=1)
        return found
