# SPDX-License-Identifier: Apache-2.0
"""VTK's passes of a picture: shadow maps, surfaces, ambient occlusion, text."""

import numpy as np

SHADOW_MAP = 1024  # pixels
SEARCH, SAMPLES = 5, 12  # samples of the shadow map for a pixel
LIGHT_RADIUS = 0.13  # of the disc that the key light shines from, seen from the cloth, rad


def spiral(count):
    """Points [count, 2] spread evenly over the unit disc."""
    radius, angle = np.sqrt((np.arange(count) + 0.5) / count), 2.39996 * np.arange(count)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def soft_shadow(width):
    """A line of VTK's shader of shadows, and the code in its place. width: of the shadow map, m.

    VTK's own shadow takes one sample of the map and fades with the distance to what is above, so that there is hardly
    any shadow where surfaces are near each other. Here a few samples say how far away that is, and more say from what
    share of the light's disc the place is lit. Where a version of VTK has no such line its own shadow stays.
    """

    def stored(x, y, scale):
        return f"stored = texture2D(shadowMap, projected + turn * ({scale} * vec2({x:.4f}, {y:.4f}))).r;"

    search = "\n".join(
        f"{stored(x, y, 0.03)} if (stored > 1.0 && stored < near) {{ found += 1.0; blockers += stored; }}"
        for x, y in spiral(SEARCH)
    )
    shares = "\n".join(
        f"{stored(x, y, 'spread')} e = stored < 1.0 ? 1.0 : min(1.03 * stored * depthCExpActual, 1.0); "
        "e *= e; e *= e; e *= e; lit += e * e;"
        for x, y in spiral(SAMPLES)
    )
    return (
        "expFactor = depthCExpBlured * depthCExpActual;",
        f"""
        float stored, e, found = 0.0, blockers = 0.0, near = 0.96 / depthCExpActual;
        float angle = 6.2832 * fract(52.9829 * fract(dot(gl_FragCoord.xy, vec2(0.06711, 0.00584))));
        mat2 turn = mat2(cos(angle), sin(angle), -sin(angle), cos(angle));
        {search}
        expFactor = 1.0;
        if (found > 0.0) {{
          float gap = ldepth - log(blockers / found) / depthC;
          float spread = {1.2 / SHADOW_MAP:.6f} + {LIGHT_RADIUS / width:.6f} * (sFarZ - sNearZ) * gap, lit = 0.0;
          {shares}
          expFactor = lit / {SAMPLES}.0;
        }}
    """,
    )


def soften(actor, width):
    """Gives an actor soft shadows; width: of the shadow map, m."""
    line, code = soft_shadow(width)
    actor.GetShaderProperty().AddFragmentShaderReplacement(line, False, code, False)


def _sequence(*passes):
    from vtkmodules.vtkRenderingOpenGL2 import vtkRenderPassCollection, vtkSequencePass

    collection, sequence = vtkRenderPassCollection(), vtkSequencePass()
    for one in passes:
        collection.AddItem(one)
    sequence.SetPasses(collection)
    return sequence


def set_passes(renderer, occlusion, reach):
    """Gives a renderer its passes, and returns those to free at the end.

    occlusion: samples of ambient occlusion, 0: none. reach: how large the scene is, m.
    """
    import vtkmodules.vtkRenderingOpenGL2 as gl

    baker, shadow = gl.vtkShadowMapBakerPass(), gl.vtkShadowMapPass()
    baker.SetResolution(SHADOW_MAP)
    shadow.SetShadowMapBakerPass(baker)
    camera = renderer.GetActiveCamera()

    def see_a_square(source, _):
        """VTK draws a shadow map with the aspect ratio of the window, and reads it as a square."""
        light = source.GetActiveCamera()
        if light is not camera:
            light.SetUseExplicitAspectRatio(True)
            light.SetExplicitAspectRatio(1.0)

    renderer.AddObserver("ActiveCameraEvent", see_a_square)
    surfaces = gl.vtkCameraPass()
    surfaces.SetDelegatePass(_sequence(baker, shadow, gl.vtkLightsPass(), gl.vtkTranslucentPass()))
    last = surfaces
    if occlusion:
        last = gl.vtkSSAOPass()
        last.SetRadius(0.08 * reach)
        last.SetBias(0.004 * reach)
        last.SetKernelSize(occlusion)
        if hasattr(last, "SetIntensityShift"):  # VTK from 9.2 on: without it the rim of the ground shows a little
            last.SetIntensityShift(0.1)
        last.BlurOn()
        last.SetDelegatePass(surfaces)
    whole = _sequence(last, gl.vtkOverlayPass())
    renderer.SetPass(whole)
    return whole, baker, shadow
