"""The checkpoints of a training that is not finished: one file for each training of a search, plain arrays."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ldsim.artefacts.atomic import creating
from ldsim.artefacts.sealed_file import check_size, datasets, opened
from ldsim.errors import ArtefactError

# In the folder of a run, beside the model that it becomes.
PARTIAL = "model.partial"

Arrays = Mapping[str, NDArray[np.generic]]


class TrainingStore:
    """The checkpoint file of one training.

    Args:
        identity: hash of the data and the options; another identity is another training.
    """

    def __init__(self, folder: Path, name: str, identity: str) -> None:
        self._path = folder / f"{name}.checkpoint.h5"
        self._identity = identity

    def load(self) -> Arrays | None:
        """What this very training saved last; None where there is nothing, or nothing readable."""
        try:
            with opened(self._path) as file:
                if file.attrs["identity"] != self._identity:
                    return None
                for data in datasets(file).values():
                    check_size(data)
                found = {name: np.asarray(data[()]) for name, data in datasets(file).items()}
                return found if file.attrs["contents"] == _contents(found) else None
        except (OSError, ArtefactError):
            return None

    def save(self, arrays: Arrays) -> None:
        """Replace the checkpoint; whole or not at all."""
        with creating(self._path) as file:
            file.attrs["identity"], file.attrs["contents"] = self._identity, _contents(arrays)
            for name, values in arrays.items():
                file[name] = values


def _contents(arrays: Arrays) -> str:
    """Name, type and shape of every array: another list is no checkpoint of ours."""
    found = {name: np.asarray(values) for name, values in arrays.items()}
    return "; ".join(f"{name} {found.dtype} {found.shape}" for name, found in sorted(found.items()))


def remove_checkpoints(folder: Path) -> None:
    """Forget all checkpoints, once the model is written."""
    shutil.rmtree(folder, ignore_errors=True)
