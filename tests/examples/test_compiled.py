"""The compiled examples, built and run by the commands of their first comments, end where the library called from
Python ends."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from ldsim.mechanics.scene import Scene
from ldsim.runtime.compilers import HERE
from ldsim.runtime.library import NativeModel, NativeSolid
from tests.examples.conftest import EXAMPLES, farthest, pulled

NUMBER = r"([-+]?\d+\.\d+)"
needs_cpp = pytest.mark.skipif(shutil.which("g++") is None, reason="g++ is not installed: it builds the example in C++")
needs_mono = pytest.mark.skipif(
    shutil.which("mcs") is None or shutil.which("mono") is None,
    reason="mono is not installed: apt-get install mono-mcs mono-runtime",
)


def commands(example: Path) -> str:
    """Those of its first comment, without `ldsim export`, which is done."""
    comment = example.read_text("utf-8").split("\n#include")[0].split("\nusing")[0]
    found = re.findall(r"^//     (.+)$", comment, re.M)
    assert found[0].startswith("ldsim export runs/demo --format c")
    return "\n".join(found[1:]).replace("linux-x86_64", HERE)


def said(root: Path, script: str) -> str:
    done = subprocess.run(["sh", "-e", "-c", script], cwd=root, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(
    "example", [pytest.param("cpp/main.cpp", marks=needs_cpp), pytest.param("csharp/Program.cs", marks=needs_mono)]
)
def test_a_host_leaves_the_vertex_where_python_does(root: Path, model: NativeModel, scene: Scene, example: str) -> None:
    text = said(root, commands(EXAMPLES / example))
    vertex = re.search(r"vertex (\d+) hangs", text)
    numbers = np.array(re.findall(NUMBER, text), dtype=float)
    position, force = pulled(model, scene)
    assert vertex is not None and int(vertex[1]) == farthest(scene)
    assert np.linalg.norm(position - scene.mesh.vertices[farthest(scene)]) > 0.01 * scene.mesh.diagonal
    np.testing.assert_allclose(numbers[:3], position, rtol=0, atol=1e-6)
    np.testing.assert_allclose(numbers[3:], force, rtol=1e-5, atol=1e-6)


def test_the_example_in_c_pulls_as_python_does(root: Path, model: NativeModel, scene: Scene) -> None:
    """It lies beside the exported model: takes hold after 20 steps, lets go after 120, and tells of every 20th."""
    text = said(root, "cd runs/demo/export/demo-c && make -s && ./example")
    lines = [np.array(re.findall(NUMBER, line), dtype=float) for line in text.splitlines()]
    x, solid, grab = scene.mesh.vertices, NativeSolid(model), 0
    vertex = int(np.linalg.norm(x - x[0], axis=1).argmax())
    for step in range(200):
        u = solid.displacement(np.array([vertex]))[0]
        if step == 20:
            grab = solid.grab(x[vertex] + u, x[vertex] + u + [0.25 * scene.mesh.diagonal, 0.0, 0.0])
        if step == 120:
            solid.release(grab)
        solid.step()
        if step % 20 == 19:
            told = lines[step // 20]
            np.testing.assert_allclose(told[1:4], solid.displacement(np.array([vertex]))[0], rtol=0, atol=1e-6)
            force = solid.force(grab)[0] if 20 <= step < 120 else 0.0
            np.testing.assert_allclose(told[4], force, rtol=0, atol=1e-4)
    assert len(lines) == 10 and max(line[4] for line in lines) > 0.1


ALLOCATION = """
static class Measured
{
    static void Main()
    {
        using (var model = new Model(System.IO.File.ReadAllBytes("model.ldsim")))
        using (var solid = new Solid(model))
        {
            var point = new[] { solid.Positions[POINT], solid.Positions[POINT + 1], solid.Positions[POINT + 2] };
            var force = new double[3];
            uint pull = solid.Grab(point, point);
            long bytes = 0;
            for (int frame = 0; frame < 20; frame++)
            {
                if (frame == 10) bytes = System.GC.GetAllocatedBytesForCurrentThread();
                point[1] += 1e-4;
                solid.Move(pull, point);
                solid.Step();
                solid.Force(pull, force);
            }
            System.Console.WriteLine(System.GC.GetAllocatedBytesForCurrentThread() - bytes);
        }
    }
}
"""


@needs_mono
def test_a_frame_in_csharp_allocates_nothing(root: Path, scene: Scene) -> None:
    folder = root / "runs" / "demo" / "export" / "demo-c"
    (folder / "Measured.cs").write_text(ALLOCATION.replace("POINT", str(3 * farthest(scene))), encoding="utf-8")
    shutil.copy(EXAMPLES / "csharp" / "Solid.cs", folder)
    script = f"mcs -out:measured.exe Measured.cs Solid.cs && LD_LIBRARY_PATH={HERE} mono measured.exe"
    assert int(said(folder, script)) == 0
