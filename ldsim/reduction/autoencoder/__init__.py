"""The autoencoder and its training: the one package that imports torch for machine learning."""

from ldsim.reduction.autoencoder.full_space import FullSpaceTrained, train_full_space
from ldsim.reduction.autoencoder.options import Forces, Trained, TrainingOptions
from ldsim.reduction.autoencoder.training import Checkpoint, train, train_ordered

__all__ = [
    "Checkpoint",
    "Forces",
    "FullSpaceTrained",
    "Trained",
    "TrainingOptions",
    "train",
    "train_full_space",
    "train_ordered",
]
