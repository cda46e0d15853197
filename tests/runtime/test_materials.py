"""The materials in C have the energies, stresses and tangents that every implementation is held to."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path

import numpy as np
import pytest

from ldsim.errors import SceneError
from ldsim.mechanics.materials import MATERIALS
from ldsim.runtime import model_file
from tests.mechanics.material_vectors import LAM, MU, read, stress_change
from tests.runtime.problems import latent

NUMBERS = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
POINT = [ctypes.c_int, NUMBERS, ctypes.c_double, ctypes.c_double]


@pytest.fixture(scope="module")
def materials(cc: str, sources: Path, tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    made = tmp_path_factory.mktemp("materials") / "materials.so"
    file = Path(__file__).with_name("material_point.c")
    subprocess.run([cc, "-std=c99", "-O2", "-shared", "-fPIC", f"-I{sources}", file, "-o", made, "-lm"], check=True)
    found = ctypes.CDLL(str(made))
    found.energy_stress.argtypes, found.energy_stress.restype = [*POINT, NUMBERS], ctypes.c_double
    found.tangent.argtypes, found.tangent.restype = [*POINT, *[NUMBERS] * 4], None
    return found


@pytest.mark.parametrize("name", MATERIALS)
def test_a_material_has_the_same_energy_stress_and_tangent(materials: ctypes.CDLL, name: str) -> None:
    for case in read()[name]:
        F, P = np.array(case["F"], dtype=np.float64), np.empty(9)
        density = materials.energy_stress(MATERIALS[name], F, MU, LAM, P)
        if case["density"] is None:
            assert density == np.inf
            continue
        assert density == pytest.approx(case["density"], rel=1e-12, abs=1e-9)
        np.testing.assert_allclose(P, case["stress"], rtol=1e-10, atol=1e-9 * MU)
        parts = [np.empty(size) for size in (9, 9, 6, 6)]
        materials.tangent(MATERIALS[name], F, MU, LAM, *parts)
        change = stress_change(*parts, np.reshape(case["dF"], (3, 3)))
        np.testing.assert_allclose(change.ravel(), case["clamped_change"], rtol=1e-8, atol=1e-8 * MU)


def test_a_material_that_the_library_does_not_have_is_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(model_file, "KNOWN", ("linear",))
    with pytest.raises(SceneError, match="the C library does not know the material 'neo_hookean'; it knows linear"):
        model_file.model_bytes(latent())
