# SPDX-License-Identifier: GPL-3.0-or-later
"""Symmetric Gaussian quadrature on triangles."""

import numpy as np
from numpy.typing import NDArray


def triangle_rule(degree: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Barycentric points (K, 3) and weights (K,) that sum to 1, exact for polynomials up to `degree` (1, 2, 4 or 5).

    Dunavant, "High degree efficient symmetrical Gaussian quadrature rules for the triangle", Int. J. Numer. Methods
    Eng. 21 (1985), table II; all points inside, all weights positive. Degree 5 is Radon's rule in closed form.
    """
    orbits = _RULES[degree]
    points, weights = [], []
    for weight, a in orbits:
        orbit = {(a, a, 1 - 2 * a), (a, 1 - 2 * a, a), (1 - 2 * a, a, a)} if a != 1 / 3 else {(1 / 3, 1 / 3, 1 / 3)}
        for point in sorted(orbit):
            points.append(point)
            weights.append(weight)
    return np.array(points), np.array(weights)


_ROOT15 = np.sqrt(15.0)

#: For each degree the orbits (weight of each point, barycentric coordinate that occurs twice).
_RULES = {
    1: ((1.0, 1 / 3),),
    2: ((1 / 3, 1 / 6),),
    4: ((0.223381589678011465, 0.445948490915964886), (0.109951743655321868, 0.091576213509770743)),
    5: (
        (9 / 40, 1 / 3),
        ((155 + _ROOT15) / 1200, (6 + _ROOT15) / 21),
        ((155 - _ROOT15) / 1200, (6 - _ROOT15) / 21),
    ),
}
