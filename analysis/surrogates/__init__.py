"""Response surfaces over (mu_s, G_p): fit, Monte Carlo, variance shares of the inputs, and the stopping rule.

`surrogate.fit` gives a `Surrogate`; `monte_carlo`, `sensitivity` and `stopping` use one.
Rule: numpy, scipy, `pdem` and what lies below it; no file and no pandas.  All names are imported on first use.
"""

from ..errors_and_files import lazy_names

_HOMES = {
    "Assessment": ".stopping",
    "Sensitivity": ".sensitivity",
    "Surrogate": ".surrogate",
    "SurrogateError": ".surrogate",
    "assess": ".stopping",
    "fill": ".surrogate",
    "fit": ".surrogate",
    "nested_order": ".stopping",
    "smoothed": ".surrogate",
}
__all__ = list(_HOMES)

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
