# SPDX-License-Identifier: GPL-3.0-or-later
"""What Cycles bakes and this does not is named in the warnings, and nothing else is."""

import pytest


@pytest.fixture
def warnings(build, read):
    """Those of a scene that has a lamp besides."""
    build.quad("Lamp", build.light(), z=5, down=True)
    return lambda: read().warnings


@pytest.fixture
def said(build, warnings):
    """What is said of a material."""

    def said(material):
        build.quad("Sheet", material)
        return [text.removeprefix("material 'Odd' on object 'Sheet': ") for text in warnings()]

    return said


ROUGH = "Roughness of shader 'Diffuse BSDF' is not simulated, it scatters as a matt one"


@pytest.mark.parametrize(
    ("shader", "inputs", "text"),
    [
        ("ShaderNodeBsdfDiffuse", {}, None),
        ("ShaderNodeBsdfDiffuse", {"Roughness": 0.5}, ROUGH),
        ("ShaderNodeBsdfSheen", {}, "shader 'Sheen BSDF' is taken as diffuse reflection"),
        ("ShaderNodeBsdfToon", {}, "shader 'Toon BSDF' is taken as diffuse reflection"),
        ("ShaderNodeBsdfTranslucent", {}, "shader 'Translucent BSDF' is taken as diffuse reflection"),
    ],
)
def test_what_scatters_otherwise_is_named(build, said, shader, inputs, text):
    assert said(build.material("Odd", shader, **inputs)) == [text] * (text is not None)
