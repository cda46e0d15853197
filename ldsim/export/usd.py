"""USD with blend shapes: the basis as offsets of a skinned mesh, the coordinates as their weights (UsdSkel)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ldsim.arrays import Array
from ldsim.export.drawn import Drawn
from ldsim.export.playback import Playback


def write_usd(playback: Playback, path: Path) -> None:
    """Write the surface with one blend shape a column of U and the weights q of each frame, metres.

    Raises:
        ExportError: the motion is of the full space, which has no basis.
    """
    # An optional dependency: `formats.FORMATS` says so before this is called.
    from pxr import Usd, UsdGeom, UsdSkel

    U, coordinates = playback.reduced("USD")
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    # USD's up is y or z; gravity along another axis leaves the solid lying.
    UsdGeom.SetStageUpAxis(stage, "Z" if int(np.abs(playback.scene.gravity).argmax()) == 2 else "Y")
    stage.SetTimeCodesPerSecond(1 / playback.frame_seconds)
    stage.SetFramesPerSecond(1 / playback.frame_seconds)
    stage.SetStartTimeCode(1)  # frame i is the state at (i + 1) h, and time code 0 is rest
    stage.SetEndTimeCode(playback.frames)
    stage.SetDefaultPrim(UsdSkel.Root.Define(stage, "/solid").GetPrim())
    modes = _define_surface(stage, playback.drawn, U)
    _define_motion(stage, modes, coordinates)
    target = path.with_name(path.name + ".usdc")
    try:
        stage.Export(str(target))
        target.replace(path)
    finally:
        target.unlink(missing_ok=True)


def _define_surface(stage: Any, drawn: Drawn, U: Array) -> list[str]:
    """The mesh at /solid/surface and its blend shapes; returns their names."""
    from pxr import Sdf, UsdGeom, UsdSkel, Vt

    rest = drawn.rest.astype(np.float32)
    mesh = UsdGeom.Mesh.Define(stage, "/solid/surface")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(rest))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(drawn.triangles), 3, dtype=np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(drawn.triangles.ravel()))
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([rest.min(axis=0), rest.max(axis=0)])))
    if drawn.skin is not None and drawn.skin.uv is not None:
        st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
        st.Set(Vt.Vec2fArray.FromNumpy((drawn.skin.uv * [1, -1] + [0, 1]).astype(np.float32)))  # v goes up in USD
    modes = drawn.moved(U.reshape(-1, 3, U.shape[1])).astype(np.float32)
    names = [f"mode_{j}" for j in range(modes.shape[2])]
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateBlendShapesAttr(names)
    targets = binding.CreateBlendShapeTargetsRel()
    for j, name in enumerate(names):
        shape = UsdSkel.BlendShape.Define(stage, f"/solid/surface/{name}")
        shape.CreateOffsetsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(modes[:, :, j])))
        targets.AddTarget(shape.GetPath())
    return names


def _define_motion(stage: Any, modes: list[str], coordinates: Array) -> None:
    """The weights of each frame, and the skeleton without joints through which USD applies them."""
    from pxr import UsdSkel, Vt

    skeleton = UsdSkel.Skeleton.Define(stage, "/solid/skeleton")
    animation = UsdSkel.Animation.Define(stage, "/solid/skeleton/motion")
    animation.CreateBlendShapesAttr(modes)
    weights = animation.CreateBlendShapeWeightsAttr()
    for frame, q in enumerate(coordinates.astype(np.float32)):
        weights.Set(Vt.FloatArray.FromNumpy(np.ascontiguousarray(q)), frame + 1)
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    surface = UsdSkel.BindingAPI.Apply(stage.GetPrimAtPath("/solid/surface"))
    surface.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
