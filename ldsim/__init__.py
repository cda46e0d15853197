"""Reduced deformable simulation in a learned latent space (Fulton et al., Eurographics 2019)."""

from ldsim.compiled import use_kernel_cache

__version__ = "0.1.0"

use_kernel_cache()
