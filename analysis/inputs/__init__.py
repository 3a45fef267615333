"""Measured pairs of mu_s and G_p, or stated distributions, and their joint distribution: marginals, copula, refits.

Rule: numpy, scipy, `copulas` and what lies below it; no file but the table of measurements, and no pandas.  `pairs`
needs numpy alone (and openpyxl for a table in .xlsx); the other names are imported on first use.
"""

from ..errors_and_files import lazy_names
from .pairs import InputError, check_pairs, read_pairs

__all__ = [
    "InputError",
    "Joint",
    "JointFit",
    "Marginal",
    "MarginalError",
    "SpecifiedInputs",
    "bootstrap_joints",
    "bootstrap_specified",
    "check_pairs",
    "fit_joint",
    "joint_from_distributions",
    "read_pairs",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "Joint": ".joint",
        "JointFit": ".joint",
        "Marginal": ".marginals",
        "MarginalError": ".marginal_families",
        "SpecifiedInputs": ".specified",
        "bootstrap_joints": ".joint",
        "bootstrap_specified": ".specified",
        "fit_joint": ".joint",
        "joint_from_distributions": ".specified",
    },
)
