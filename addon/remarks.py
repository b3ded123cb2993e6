# SPDX-License-Identifier: GPL-3.0-or-later
"""Remarks on what all of a scene has together, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

#: Materials of which a scene has less, as a share of all that reflects, hardly light others.
LEAST = 0.02


def listed(names: Sequence[str]) -> str:
    """Some names, at most three of them."""
    shown = ", ".join(f"'{name}'" for name in names[:3])
    return f"{shown} and {len(names) - 3} more" if len(names) > 3 else shown


def of_shine(names: Sequence[str], shiny: np.ndarray, triangles: np.ndarray, albedo: np.ndarray) -> tuple[str, ...]:
    """The materials, of those with these names, that reflect much without scattering it, for triangles (T,3,3) with
    their albedo (T,3) and the numbers (T,) of their materials, counted from 1.
    """
    if not names:
        return ()
    a, b, c = triangles.swapaxes(0, 1)
    reflected = np.linalg.norm(np.cross(b - a, c - a), axis=1) * albedo.mean(axis=1)
    shares = np.bincount(shiny, reflected, len(names) + 1)[1:] / max(reflected.sum(), np.finfo(float).tiny)
    much = [name for name, share in zip(names, shares, strict=True) if share > LEAST]
    if not much:
        return ()
    return (f"what metal and gloss of material {listed(much)} reflect is taken as diffuse: light around may be some "
            "percent off",)  # fmt: skip
