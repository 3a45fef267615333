"""Response surfaces over (mu_s, G_p): fit, distribution of a response, variance shares of the inputs, stopping rule.

`surrogate.fit` gives a `Surrogate`; `distribution`, `monte_carlo`, `sensitivity` and `stopping` use one.
Rule: numpy, scipy, `pdem` and what lies below it; no file and no pandas.  All names are imported on first use.
"""

from ..errors_and_files import lazy_names

_HOMES = {
    "Assessment": ".stopping",
    "Distribution": ".distribution",
    "Sensitivity": ".sensitivity",
    "Surrogate": ".surrogate",
    "SurrogateError": ".surrogate",
    "assess": ".stopping",
    "moments_and_quantiles": ".distribution",
    "fill": ".surrogate",
    "fit": ".surrogate",
}
__all__ = list(_HOMES)

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
