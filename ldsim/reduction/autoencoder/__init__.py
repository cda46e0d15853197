"""The autoencoder and its training: the one package that imports torch for machine learning."""

from ldsim.reduction.autoencoder.options import Forces, Trained, TrainingOptions
from ldsim.reduction.autoencoder.training import Checkpoint, train, train_ordered

__all__ = ["Checkpoint", "Forces", "Trained", "TrainingOptions", "train", "train_ordered"]
