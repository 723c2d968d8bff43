"""The stiffness prior: a codebook learned over many objects, in place of refinement for each (paper, Sec. 3.3)."""

from egophys_core.prior.checkpoint import DEFAULT, default_codebook, load_codebook, save_codebook
from egophys_core.prior.inference import outside_range, with_prior

__all__ = ["DEFAULT", "default_codebook", "load_codebook", "outside_range", "save_codebook", "with_prior"]
