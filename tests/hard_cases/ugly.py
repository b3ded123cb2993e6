# SPDX-License-Identifier: GPL-3.0-or-later
"""Random ugly meshes, small enough to be solved by the hundred."""

import fmm_core
import numpy as np
import shapes
from hypothesis import assume
from hypothesis import strategies as st

KINDS = ("triangle", "quad", "box", "room", "sliver", "speck", "double", "opposite", "near", "line", "fan")

#: Distance of a piece from the one it is a copy of: the two ends of a ray are lifted by less together.
NEAR = 2e-5


def _piece(kind, rng, before):
    """Triangles (T, 3, 3) of one piece; some of them are made of the pieces before."""
    corners = rng.uniform(-1, 1, (3, 3))
    if kind in ("double", "opposite", "near") and before:
        again = before[rng.integers(len(before))]
        turned = again if kind == "double" else again[:, ::-1]
        cross = np.cross(again[0, 1] - again[0, 0], again[0, 2] - again[0, 0])
        # Closer than rays can tell apart nothing is promised: a copy of a copy must not come back to where that was.
        apart = NEAR * len(before) * cross / max(np.linalg.norm(cross), 1e-300)
        return turned + (apart if kind == "near" else 0.0)
    if kind == "quad":
        a, b, c = corners
        return shapes.quad(a, b, c, a + c - b)
    if kind in ("box", "room"):
        size = rng.uniform(0.1, 2.0, 3)
        box = shapes.room(size) + rng.uniform(-1, 1, 3) - size / 2
        return box[:, ::-1] if kind == "box" else box
    if kind == "sliver":
        a, b, _ = corners
        return np.array([[a, b, (a + b) / 2 + 1e-6 * corners[2]]])
    if kind == "speck":
        return (corners[0] + 1e-3 * rng.uniform(-1, 1, (3, 3)))[None]
    if kind == "line":
        a, b, _ = corners
        return np.array([[a, b, (a + b) / 2]])
    if kind == "fan":
        hub, edge = corners[:2]
        return np.array([[hub, edge, end] for end in rng.uniform(-1, 1, (4, 3))])
    return corners[None]


#: Makes lamps of one W, W/sr, W/m^2 or W/(m^2 sr) at random places.
LAMPS = {
    "point": lambda rng: fmm_core.PointLight(rng.uniform(-1, 1, 3), 1.0, rng.choice([0.0, 0.1])),
    "spot": lambda rng: fmm_core.SpotLight(
        rng.uniform(-1, 1, 3), 1.0, direction=rng.normal(size=3), angle=rng.uniform(0.1, 2.0)
    ),
    "sun": lambda rng: fmm_core.SunLight(rng.normal(size=3), 1.0, rng.choice([0.0, 0.02])),
    "area": lambda rng: fmm_core.AreaLight(rng.uniform(-1, 1, 3), *rng.uniform(-0.3, 0.3, (2, 3)), 1.0),
}


@st.composite
def scenes(draw, lamps=False):
    """A `Scene` of one to six pieces that may cross, touch, double or hide each other, lit by lamps and sky as well."""
    kinds = draw(st.lists(st.sampled_from(KINDS), min_size=1, max_size=6))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    pieces = []
    for kind in kinds:
        pieces.append(_piece(kind, rng, pieces))
    triangles = np.concatenate(pieces)
    count = len(triangles)
    albedo = draw(st.sampled_from([0.0, 0.5, 0.9, 1.0]))
    emission = 10.0 ** rng.uniform(-4, 4, (count, 3)) * (rng.random((count, 1)) < 0.5)
    emission[rng.integers(count)] = 1.0
    two_sided = rng.random(count) < draw(st.sampled_from([0.0, 0.5, 1.0]))
    others = {}
    if lamps:
        kinds = draw(st.lists(st.sampled_from(sorted(LAMPS)), max_size=2))
        others = {"lights": [LAMPS[kind](rng) for kind in kinds]}
        others["sky"] = fmm_core.Sky(1.0) if draw(st.booleans()) else None
        emission *= draw(st.sampled_from([0.0, 1.0])) if kinds or others["sky"] else 1.0
    try:
        return fmm_core.Scene(triangles, albedo * rng.random((count, 3)) ** 0.2, emission, two_sided, **others)
    except fmm_core.Error:
        # The only emitter, or all there is, may have no area.
        assume(False)
