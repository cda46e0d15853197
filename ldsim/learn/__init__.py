"""The autoencoder and its training: the one package that imports torch for machine learning."""

from ldsim.learn.full_space import FullSpaceTrained, train_full_space
from ldsim.learn.options import Forces, Trained, TrainingOptions
from ldsim.learn.training import Checkpoint, train, train_ordered

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
