"""USD with blend shapes: the basis as offsets of a skinned mesh, the coordinates as their animated weights (UsdSkel)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ldsim.errors import ExportError
from ldsim.export.source import Playback, surface_of


def write_usd(playback: Playback, path: Path) -> None:
    """Write the surface with one blend shape a column of U and the weights q of each frame, metres.

    Raises:
        ExportError: the motion is of the full space, which has no basis.
    """
    # An optional dependency: `formats.FORMATS` says so before this is called.
    from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt

    if playback.U is None or playback.coordinates is None:
        raise ExportError(
            "USD plays the columns of a basis and the full space has none; "
            "use --space linear or latent, or the format ply or vtk"
        )
    surface = surface_of(playback.mesh)
    rest = playback.mesh.vertices[surface.vertices].astype(np.float32)
    modes = playback.U.reshape(playback.mesh.n_vertices, 3, -1)[surface.vertices]
    names = [f"mode_{j}" for j in range(modes.shape[2])]
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z if abs(playback.scene.gravity[2]) > 0 else UsdGeom.Tokens.y)
    stage.SetTimeCodesPerSecond(1 / playback.frame_seconds)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(playback.frames - 1)
    root = UsdSkel.Root.Define(stage, "/solid")
    stage.SetDefaultPrim(root.GetPrim())
    mesh = UsdGeom.Mesh.Define(stage, "/solid/surface")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(rest))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(surface.triangles), 3, dtype=np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(surface.triangles.ravel()))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    skeleton = UsdSkel.Skeleton.Define(stage, "/solid/skeleton")
    animation = UsdSkel.Animation.Define(stage, "/solid/skeleton/motion")
    animation.CreateBlendShapesAttr(names)
    weights = animation.CreateBlendShapeWeightsAttr()
    for frame, q in enumerate(playback.coordinates.astype(np.float32)):
        weights.Set(Vt.FloatArray.FromNumpy(np.ascontiguousarray(q)), frame)
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    binding.CreateBlendShapesAttr(names)
    targets = binding.CreateBlendShapeTargetsRel()
    for j, name in enumerate(names):
        shape = UsdSkel.BlendShape.Define(stage, f"/solid/surface/{name}")
        offsets = np.ascontiguousarray(modes[:, :, j], dtype=np.float32)
        shape.CreateOffsetsAttr(Vt.Vec3fArray.FromNumpy(offsets))
        targets.AddTarget(shape.GetPath())
    lows, highs = rest.min(axis=0), rest.max(axis=0)
    mesh.CreateExtentAttr([Gf.Vec3f(*map(float, lows)), Gf.Vec3f(*map(float, highs))])
    target = path.with_name(path.name + ".usdc")
    try:
        stage.Export(str(target))
        target.replace(path)
    finally:
        target.unlink(missing_ok=True)
