"""Reduced deformable simulation in a learned latent space (Fulton et al., Eurographics 2019)."""

__version__ = "0.1.0"
