"""Representative points: few inputs with probabilities that stand for the whole joint distribution.

Rule: numpy, scipy, `inputs` and what lies below it; no file but the text of points.csv.  `representative_points` needs
numpy only, so that a reader of results does not load scipy: the other names are imported when they are asked for.
"""

from ..errors_and_files import lazy_names
from .representative_points import Point, PointsError, RepresentativePoints

__all__ = ["Point", "PointsError", "RepresentativePoints", "bootstrap_probabilities", "select_points"]

__getattr__, __dir__ = lazy_names(__name__, dict.fromkeys(("bootstrap_probabilities", "select_points"), ".selection"))
