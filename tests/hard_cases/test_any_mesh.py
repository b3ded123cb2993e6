# SPDX-License-Identifier: GPL-3.0-or-later
"""What holds for any mesh, however ugly: a hundred of them, and two thousand in the slow set."""

import fmm_core
import numpy as np
import pytest
from energy import audit
from fmm_core import _binding
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from ugly import scenes

#: Light may be created by no more than this share of what is emitted.
CREATED = 5e-3
#: The same meshes each time: a change is judged by what it changes.
QUIET = {"deadline": None, "derandomize": True, "suppress_health_check": list(HealthCheck)}
#: How many meshes: by default, and in the slow set.
CASES = pytest.mark.parametrize("cases", [100, pytest.param(2000, marks=pytest.mark.slow)])
METHODS = pytest.mark.parametrize("method", ["direct", "fmm"])


def for_any(cases, meshes, **drawn):
    """Runs what it decorates for so many of the meshes."""

    def run(holds):
        settings(max_examples=cases, **QUIET)(given(scene=meshes, **drawn)(holds))()

    return run


@CASES
@METHODS
def test_light_is_finite_positive_and_not_created(cases, method):
    @for_any(cases // 2, scenes(lamps=True))
    def holds(scene):
        result = audit(scene, fmm_core.Settings(particles=200, probes=0, method=method))
        assert not any("stopped" in text for text in result.solution.report["warnings"])
        assert result.created <= CREATED


def _moved(scene, rng):
    """A scene turned, shifted and in another order; the turn (3, 3) and the shift (3,)."""
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    order = rng.permutation(len(scene.triangles))
    shift = rng.uniform(-5, 5, 3)
    moved = fmm_core.Scene(
        scene.triangles[order] @ turn + shift, scene.albedo[order], scene.emission[order], scene.two_sided[order]
    )
    return moved, turn, shift


@CASES
def test_result_does_not_depend_on_place_turn_and_order(cases):
    @for_any(cases, scenes(), seed=st.integers(0, 2**32 - 1))
    def holds(scene, seed):
        rng = np.random.default_rng(seed)
        moved, turn, shift = _moved(scene, rng)
        # Rays that graze an edge may fall on either side of it once turned: light without shadows is the same.
        bare = fmm_core.Settings(
            particles=150, probes=0, method="direct", effects={"occlusion": False}, max_iterations=1
        )
        first, second = fmm_core.solve(scene, bare), fmm_core.solve(moved, bare)
        points = scene.centre + scene.size * rng.uniform(-1, 1, (40, 3))
        normals = rng.normal(size=(40, 3))
        before, after = first.irradiance(points, normals), second.irradiance(points @ turn + shift, normals @ turn)
        # The plane of a sliver a millionth as wide as long turns by its rounding.
        assert np.abs(after - before).max() <= 1e-4 * np.abs(before).max() + 1e-12 * scene.emission.max()


@CASES
def test_light_is_linear_in_emission(cases):
    @for_any(cases, scenes(), factor=st.floats(1e-6, 1e6))
    def holds(scene, factor):
        # Once more, so that relighting takes a row for each triangle.
        scene = fmm_core.Scene(scene.triangles, scene.albedo, scene.emission, scene.two_sided)
        solution = fmm_core.solve(scene, fmm_core.Settings(particles=120, probes=0))
        rng, particles = np.random.default_rng(0), solution.particles
        some = rng.permutation(len(particles))[:60]
        points = particles.positions[some], particles.normals[some]
        once = solution.irradiance(*points)
        part = rng.random((len(scene.triangles), 1)) * scene.emission
        one, other = (solution.relight(factor * emission) for emission in (part, scene.emission - part))
        both = one.irradiance(*points) + other.irradiance(*points)
        assert np.abs(both / factor - once).max() <= 2e-3 * once.max()


@CASES
@METHODS
def test_light_with_shadows_does_not_depend_on_place_turn_and_order(cases, method):
    @for_any(cases // 2, scenes(), seed=st.integers(0, 2**32 - 1))
    def holds(scene, seed):
        moved = _moved(scene, np.random.default_rng(seed))[0]
        options = fmm_core.Settings(particles=200, probes=0, method=method)
        first, second = (fmm_core.solve(each, options) for each in (scene, moved))
        # Which of two surfaces in one place a ray meets is chance.
        assume(np.isclose(first.particles.weights.sum(), first.particles.areas.sum()))
        received = [(each.particles.weights[:, None] * each.received).sum() for each in (first, second)]
        sent = (first.particles.weights[:, None] * first.radiosity).sum(axis=1)
        # Rays that graze an edge may fall on either side of it once turned. Each particle has 50 or more, each of which
        # tells all or nothing: three standard deviations of the difference of two such sums, weighed by what they send.
        assert abs(received[0] - received[1]) <= 3 * np.sqrt(2) * 0.5 / np.sqrt(50) * np.linalg.norm(sent)


@CASES
def test_form_factors_are_reciprocal(cases):
    @for_any(cases, scenes())
    def holds(scene):
        settings = fmm_core.Settings(particles=120, probes=0, method="direct", max_iterations=1)
        particles = fmm_core.solve(scene, settings).particles
        # One distance for all below which the kernel stops growing, which else belongs to the source.
        softening = np.full(len(particles), particles.softening.max())
        sources = _binding.Sources(particles.positions, particles.normals, softening, particles.areas, particles.shares)
        weights = particles.weights[:, None]
        some = np.random.default_rng(0).random(weights.shape) < 0.5

        def arrives(there, here):
            irradiance = sources.irradiance(particles.positions, particles.normals, np.where(here, weights, 0.0))
            return float((weights * irradiance)[there].sum())

        there, back = arrives(some, ~some), arrives(~some, some)
        assert abs(there - back) <= 1e-9 * (there + back)
