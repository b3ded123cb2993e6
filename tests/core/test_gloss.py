# SPDX-License-Identifier: GPL-3.0-or-later
"""Gloss: tables of reflection judged by the formulas that they are made from, and what an eye sees by closed forms."""

import fmm_core
import numpy as np
import pytest
import shapes
from fmm_core import Brdf, Gloss, PointLight, Sky, SunLight, patterns
from fmm_core.brdf import SHAPE, dielectric

FLOOR = shapes.quad([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0])
SETTINGS = fmm_core.Settings(particles=1000, probes=0)
ROUGHNESSES = (0.1, 0.2, 0.35, 0.6, 1.0)


def directions(cosines):
    """(K, 3) in the plane of x and z."""
    cosines = np.asarray(cosines, float)
    return np.stack([np.sqrt(1 - cosines**2), 0 * cosines, cosines], axis=1)


def upright(vectors):
    return np.broadcast_to([0.0, 0.0, 1.0], vectors.shape)


def ggx(incoming, outgoing, roughness):
    """Walter and others (2007) with the correlated Smith term, about z, with perfect facets."""
    alpha2, half = roughness**4, incoming + outgoing
    z = half[..., 2] / np.linalg.norm(half, axis=-1)
    facets = alpha2 / (np.pi * (z**2 * (alpha2 - 1) + 1) ** 2)
    tangents = [(1 - v[..., 2] ** 2) / v[..., 2] ** 2 for v in (incoming, outgoing)]
    hidden = [(np.sqrt(1 + alpha2 * tangent) - 1) / 2 for tangent in tangents]
    return facets / (1 + hidden[0] + hidden[1]) / (4 * incoming[..., 2] * outgoing[..., 2])


def random_directions(count, seed):
    found = np.random.default_rng(seed).normal(size=(count, 3))
    found[:, 2] = np.abs(found[:, 2]) + 0.05
    return found / np.linalg.norm(found, axis=1, keepdims=True)


@pytest.mark.parametrize("roughness", ROUGHNESSES)
def test_the_table_is_the_formula(roughness):
    """Where the light goes, 0.6 % on average, and 0.2 % from a roughness of 0.2 on."""
    table, outgoing = Brdf.ggx(roughness, 0.04), directions([0.2, 0.5, 0.9])
    incoming = table.directions(outgoing, upright(outgoing), patterns.shifts(np.arange(3)), 4000)
    found = table.values(incoming, outgoing[:, None], upright(outgoing)[:, None])[..., :2].sum(axis=2)
    above = incoming[..., 2] > 1e-3
    exact = np.where(above, ggx(np.where(above[..., None], incoming, [0, 0, 1.0]), outgoing[:, None], roughness), 0.0)
    weights = above * incoming[..., 2] / table.density(incoming, outgoing, upright(outgoing), 4000)
    off = (weights * np.abs(found - exact)).sum(axis=1) / (weights * exact).sum(axis=1)
    assert off.max() < (0.006 if roughness < 0.2 else 0.002)


@pytest.mark.parametrize("roughness", ROUGHNESSES)
def test_the_table_is_reciprocal(roughness):
    table, first, second = Brdf.ggx(roughness, 0.04), random_directions(2000, 0), random_directions(2000, 1)
    one, other = (table.values(*ends, upright(first)) for ends in ((first, second), (second, first)))
    assert one == pytest.approx(other, rel=1e-9)


@pytest.mark.parametrize("roughness", ROUGHNESSES)
def test_no_more_light_is_reflected_than_there_is(roughness):
    """Of perfect microfacets and of a dielectric, by quadrature over the half angles."""
    table, cosines = Brdf.ggx(roughness, 0.04), np.array([0.1, 0.3, 0.6, 0.95])
    outgoing = directions(cosines)
    # Even in tan(theta_h) / alpha up to where the facets end.
    steps = (np.arange(400) + 0.5) / 400
    theta = np.arctan(np.tan(np.pi / 2 * steps) * roughness**2)
    phi = 2 * np.pi * (np.arange(400) + 0.5) / 400
    solid = np.gradient(theta) * np.sin(theta) * 2 * np.pi / 400
    theta, phi = (x.ravel() for x in np.meshgrid(theta, phi))
    half = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)
    for cosine, eye in zip(cosines, outgoing, strict=True):
        to = half @ eye
        incoming = 2 * to[:, None] * half - eye
        values = table.values(incoming, np.broadcast_to(eye, incoming.shape), upright(incoming))
        weights = np.where((incoming[:, 2] > 0) & (to > 0), 4 * to * incoming[:, 2], 0.0) * np.tile(solid, 400)
        albedo = (values * weights[:, None]).sum(axis=0)
        assert albedo[:2].sum() < 1.0
        assert table.albedo(np.array([cosine]))[0] == pytest.approx(albedo, rel=0.02, abs=1e-4)


def test_dielectrics_reflect_what_fresnel_says():
    # Glass of index 1.5: 4 % straight ahead, 8.92 % at 60 degrees, all along the surface.
    assert dielectric(np.array([1.0, 0.5, 0.0]), 0.04) == pytest.approx([0.04, 0.0892, 1.0], abs=1e-4)


def test_a_file_of_the_merl_database_is_read(tmp_path):
    values = np.random.default_rng(0).random((3, *SHAPE)) * 1500
    values[:, :, -1] = -1.0
    path = tmp_path / "paint.binary"
    with open(path, "wb") as file:
        np.array(SHAPE, "<i4").tofile(file)
        values.tofile(file)
    table = Brdf.load(path)
    assert table.lobes == 3
    assert table.table.min() == 0
    assert table.table[5, 6, 7] == pytest.approx(values[:, 5, 6, 7] / 1500 * [1.0, 1.15, 1.66], rel=1e-6)
    path.write_bytes(path.read_bytes()[:-8])
    for wrong in (path, tmp_path / "none.binary"):
        with pytest.raises(fmm_core.Error, match=wrong.name):
            Brdf.load(wrong)


def seen(scene, cosine, count=40, settings=SETTINGS, **reflection):
    """Radiance (count, 3) of places on the floor for an eye under an angle, and the solution."""
    solution = fmm_core.solve(scene, settings)
    points, normals = shapes.random_points(FLOOR, count // 2)
    gloss = Gloss(np.broadcast_to(directions([cosine]), points.shape), **reflection)
    return solution.radiance(points, normals, gloss, solution.irradiance(points, normals)), solution


@pytest.mark.parametrize("roughness", [0.1, 0.4, 0.9])
@pytest.mark.parametrize("cosine", [0.2, 0.7])
def test_white_metal_in_a_white_furnace_is_not_to_be_seen(roughness, cosine):
    scene = fmm_core.Scene(FLOOR, 0.5, sky=Sky(1.0), glossy=1)
    found, solution = seen(scene, cosine, diffuse=0.0, facing=1.0, grazing=1.0, roughness=roughness)
    assert found.mean() == pytest.approx(1.0, rel=5e-3)
    assert found == pytest.approx(np.ones_like(found), rel=0.05)
    assert solution.report["counts"]["tables"] == 1


@pytest.mark.parametrize("cosine", [0.2, 0.7])
def test_white_plastic_in_a_white_furnace_is_not_to_be_seen(cosine):
    scene = fmm_core.Scene(FLOOR, 0.5, sky=Sky(1.0), glossy=1)
    found, _ = seen(scene, cosine, diffuse=1.0, plastic=1.0, roughness=0.3)
    # All that the layer reflects is kept from the base, but what its facets would send on to each other.
    assert found.mean() == pytest.approx(1.0, rel=0.02)


def test_a_sun_is_reflected_as_the_formula_says():
    sun = SunLight((-0.6, 0.0, -0.8), 2.0)
    scene = fmm_core.Scene(FLOOR, 0.0, lights=[sun], glossy=1)
    eye, to_sun = directions([0.6])[0], np.array([0.6, 0.0, 0.8])
    found, _ = seen(scene, 0.6, diffuse=0.0, facing=1.0, grazing=1.0, roughness=0.5)
    table = Brdf.ggx(0.5, 0.0)
    perfect, mean = table.albedo(np.array([0.6]))[0, :2].sum(), table.mean_albedo[:2].sum()
    expected = ggx(to_sun, eye, 0.5) * 0.8 * 2.0 * (1 + (1 - perfect) / perfect)
    assert mean < 1
    assert found == pytest.approx(np.full_like(found, expected), rel=5e-3)


def test_an_emitter_is_found_by_rays_of_both_kinds():
    """A panel above the floor, against the sum over its pieces."""
    panel = shapes.quad([-1, 0, 0.5], [-1, 1, 0.5], [0.5, 1, 0.5], [0.5, 0, 0.5])
    emission = np.repeat([0.0, 10.0], 2)
    scene = fmm_core.Scene(np.concatenate([FLOOR, panel]), 0.0, emission, glossy=1)
    points, normals = shapes.random_points(FLOOR, 20)
    eye = directions([0.6])
    pieces = patterns.triangles(panel, 6)
    places, area = pieces.reshape(-1, 3), 1.5 / pieces.size * 3
    for roughness in (0.15, 0.5):
        between = places - points[:, None]
        squared = (between**2).sum(axis=2)
        incoming = between / np.sqrt(squared)[..., None]
        light = 10 / np.pi * incoming[..., 2] ** 2 / squared * area
        exact = (ggx(incoming, eye[None], roughness) * light).sum(axis=1)
        gloss = Gloss(np.broadcast_to(eye, points.shape), 0.0, 1.0, 1.0, roughness=roughness)
        solution = fmm_core.solve(scene, SETTINGS)
        found = solution.radiance(points, normals, gloss, solution.irradiance(points, normals))[:, 0]
        table = Brdf.ggx(roughness, 0.0)
        found *= table.albedo(np.array([0.6]))[0, :2].sum()
        assert np.linalg.norm(found - exact) < 0.03 * np.linalg.norm(exact)


def test_a_measured_table_is_seen_as_it_is():
    table = Brdf(np.full((*SHAPE, 3), [0.1, 0.2, 0.3], np.float32) / np.float32(np.pi))
    assert table.mean_albedo == pytest.approx([0.1, 0.2, 0.3], rel=1e-3)
    scene = fmm_core.Scene(FLOOR, 0.5, sky=Sky(2.0), glossy=1)
    found, _ = seen(scene, 0.5, diffuse=0.0, facing=table.mean_albedo, measured=0, tables=(table,))
    assert found == pytest.approx(np.broadcast_to([0.2, 0.4, 0.6], found.shape), rel=0.02)


def test_gloss_is_only_found_where_the_plan_has_it():
    lamp = PointLight((0.0, 0.5, 1.0), 1.0)
    reflection = {"diffuse": 0.2, "facing": 0.6, "grazing": 1.0, "roughness": 0.3}
    right, solution = seen(fmm_core.Scene(FLOOR, 0.8, lights=[lamp], glossy=1), 0.6, **reflection)
    assert solution.report["effects"]["glossy"]["used"]
    assert solution.report["counts"]["tables"] == 1
    off = fmm_core.Settings(particles=1000, probes=0, effects={"glossy": False})
    wrong, solution = seen(fmm_core.Scene(FLOOR, 0.8, lights=[lamp], glossy=1), 0.6, settings=off, **reflection)
    assert (solution.report["counts"]["tables"], solution.report["counts"]["directed_rays"]) == (0, 0)
    assert np.linalg.norm(wrong - right) > 0.2 * np.linalg.norm(right)
    on = fmm_core.Settings(particles=1000, probes=0, effects={"glossy": True})
    _, solution = seen(fmm_core.Scene(FLOOR, 0.8, lights=[lamp]), 0.6, settings=on, **reflection)
    assert not solution.report["effects"]["glossy"]["used"]
    assert solution.report["counts"]["tables"] == 0


def test_what_does_not_shine_or_faces_away_takes_no_ray():
    scene = fmm_core.Scene(FLOOR, 0.5, sky=Sky(1.0), glossy=1)
    dull, solution = seen(scene, 0.6, diffuse=0.5)
    assert dull == pytest.approx(np.full_like(dull, 0.5), rel=1e-6)
    assert (solution.report["counts"]["tables"], solution.report["counts"]["directed_rays"]) == (0, 0)
    solution = fmm_core.solve(scene, SETTINGS)
    points, normals = shapes.random_points(FLOOR, 4)
    behind = Gloss(np.broadcast_to([0.0, 0.6, -0.8], points.shape), 0.2, 0.3, 1.0)
    found = solution.radiance(points, normals, behind, solution.irradiance(points, normals))
    assert found == pytest.approx(np.full_like(found, 0.5), rel=1e-6)
    assert solution.report["counts"]["directed_rays"] == 0


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"towards": [[0, 0, 0]], "diffuse": 0}, "towards"),
        ({"towards": [[0, 0, 1]], "diffuse": [1, 2]}, "diffuse: expected shape"),
        ({"towards": [[0, 0, 1]], "diffuse": 0, "facing": -1}, "facing: expected finite"),
        ({"towards": [[0, 0, 1]], "diffuse": 0, "measured": 0}, "measured: expected less than 0"),
    ],
)
def test_wrong_gloss_is_refused(arrays, message):
    with pytest.raises(fmm_core.Error, match=message):
        Gloss(**arrays)
