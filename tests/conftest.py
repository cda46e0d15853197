"""What every test finds: nothing of the caller's environment, and one thread a process.

Who runs the tests may have set whatever make, numba, matplotlib or ldsim itself listen to, and make sets some for the
programs that it starts. So before anything else is imported, only what is listed here is left, for the processes too
that the tests start.
"""

import os

NEEDED = ("PATH", "LD_LIBRARY_PATH", "HOME", "TMPDIR", "XDG_CACHE_HOME", "CUDA_VISIBLE_DEVICES")
OF_PYTEST = ("PYTEST_", "COV_")
# Several pools of threads on few cores wait for each other. Messages are compared in English and in one encoding.
GIVEN = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "LC_ALL": "C.UTF-8"}

for variable in set(os.environ) - set(NEEDED):
    if not variable.startswith(OF_PYTEST):
        del os.environ[variable]
os.environ.update(GIVEN)
