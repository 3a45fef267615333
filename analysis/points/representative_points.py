"""Representative points with their probabilities: the one value that all parts of the project hand on.

Chosen by `select_points`, kept in points.csv, written to and read from results.h5, drawn in figures.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..errors_and_files import GrainScatterError

if TYPE_CHECKING:
    import pandas as pd

VARIABLES = ("mu_s", "G_p")
#: Largest errors of the moments that a set of points may have without a warning: relative ones of means and standard
#: deviations, absolute ones of correlations.
MEAN_LIMIT, STD_LIMIT, CORRELATION_LIMIT = 0.01, 0.03, 0.03
CSV_COLUMNS = ("id", "mu_s", "G_p", "G_p_GPa", "probability")


class PointsError(GrainScatterError):
    """Representative points cannot be made or read as asked."""


class Point(NamedTuple):
    """One representative point: number, interparticle friction, particle shear modulus (Pa), probability."""

    id: int
    mu_s: float
    G_p: float
    probability: float


@dataclass(frozen=True)
class RepresentativePoints:
    """Points x (n, d) in SI units, columns mu_s and G_p (Pa), with probabilities (n,) that sum to 1.

    `id` (n,) numbers them, by default 0 to n - 1.  `discrepancy` is the GF-discrepancy of each marginal.
    `moment_errors` are the errors against the joint distribution, if known: of the means, then of the standard
    deviations (both relative), then of the correlations.  `method`, `seed` and `nested` say how the points were made.
    Raises PointsError if the arrays do not belong together, or if a probability is negative or their sum is not 1.
    """

    x: np.ndarray
    probability: np.ndarray
    method: str = ""
    seed: int = 0
    discrepancy: tuple[float, ...] = ()
    nested: bool = False
    id: np.ndarray = field(default_factory=lambda: np.empty(0, int))
    moment_errors: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        x, probability = np.asarray(self.x, float), np.asarray(self.probability, float)
        number = np.asarray(self.id, int) if len(self.id) else np.arange(len(x))
        if x.ndim != 2 or probability.shape != (len(x),) or number.shape != (len(x),):
            raise PointsError(f"points {x.shape}, probabilities {probability.shape}, ids {number.shape} do not match")
        if len(x) and not (probability.min() >= 0.0 and abs(probability.sum() - 1.0) < 1e-9):
            raise PointsError(
                f"probabilities of {len(x)} points: least {probability.min():g}, sum {probability.sum():.12g}, not 1"
            )
        for name, value in (("x", x), ("probability", probability), ("id", number)):
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.x)

    def __iter__(self) -> Iterator[Point]:
        """The points one by one, as `Point`."""
        columns = (self.id.tolist(), self.mu_s.tolist(), self.G_p.tolist(), self.probability.tolist())
        return (Point(*row) for row in zip(*columns, strict=True))

    def __getitem__(self, name: str) -> np.ndarray:
        """One column (n,) by its name: id, mu_s, G_p (Pa) or probability."""
        if name in VARIABLES:
            return self.x[:, VARIABLES.index(name)]
        if name in ("id", "probability"):
            return getattr(self, name)
        raise KeyError(f"points have no column {name!r}, only id, {', '.join(VARIABLES)}, probability")

    @property
    def n(self) -> int:
        """Number of points."""
        return len(self.x)

    @property
    def mu_s(self) -> np.ndarray:
        """Interparticle friction (n,)."""
        return self.x[:, 0]

    @property
    def G_p(self) -> np.ndarray:
        """Particle shear modulus (n,), Pa."""
        return self.x[:, 1]

    def moment_warnings(self) -> list[str]:
        """One line if moments differ from those of the joint distribution by more than a limit: which, how much."""
        d = self.x.shape[1]
        names = VARIABLES if d == len(VARIABLES) else tuple(f"x{i + 1}" for i in range(d))
        limits = [(f"mean of {name}", MEAN_LIMIT, ".1%") for name in names]
        limits += [(f"standard deviation of {name}", STD_LIMIT, ".1%") for name in names]
        pairs = [(one, two) for i, one in enumerate(names) for two in names[i + 1 :]]
        limits += [(f"correlation of {one} and {two}", CORRELATION_LIMIT, ".2f") for one, two in pairs]
        lost = [
            f"{name} {error:+{form}} (limit {limit:{form}})"
            for (name, limit, form), error in zip(limits, self.moment_errors, strict=bool(self.moment_errors))
            if abs(error) > limit
        ]
        text = f"points: the {self.n} points do not carry all moments of the inputs; errors: {', '.join(lost)}"
        return [text] if lost else []

    def columns(self) -> dict[str, np.ndarray]:
        """Name -> column (n,): id, mu_s, G_p (Pa), probability, as in results.h5."""
        return {name: self[name] for name in ("id", *VARIABLES, "probability")}

    def to_frame(self) -> pd.DataFrame:
        """The points as a pandas DataFrame id, mu_s, G_p (Pa), probability."""
        import pandas as pd

        return pd.DataFrame(self.columns())

    def to_csv(self) -> str:
        """The text of points.csv; every number in full."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(CSV_COLUMNS)
        for p in self:
            writer.writerow([p.id, repr(p.mu_s), repr(p.G_p), f"{p.G_p / 1e9:.4f}", repr(p.probability)])
        return out.getvalue()

    @staticmethod
    def from_csv(text: str) -> RepresentativePoints:
        """The points in the text of a points.csv."""
        lines = list(csv.DictReader(io.StringIO(text)))
        try:
            x = np.array([[float(line[name]) for name in VARIABLES] for line in lines]).reshape(-1, len(VARIABLES))
            probability = np.array([float(line["probability"]) for line in lines])
            return RepresentativePoints(x, probability, id=np.array([int(line["id"]) for line in lines], int))
        except (KeyError, TypeError, ValueError) as error:
            raise PointsError(f"points.csv: not a table of {', '.join(CSV_COLUMNS)} ({error})") from error

    def to_dict(self) -> dict:
        """A JSON-ready dictionary."""
        record = {name: getattr(self, name) for name in ("method", "seed", "nested")}
        arrays = {name: getattr(self, name).tolist() for name in ("x", "probability", "id")}
        return record | arrays | {name: list(getattr(self, name)) for name in ("discrepancy", "moment_errors")}

    @staticmethod
    def from_dict(data: dict) -> RepresentativePoints:
        """The inverse of to_dict."""
        arrays = {name: np.array(data[name]) for name in ("x", "probability", "id") if name in data}
        errors = {name: tuple(data.get(name, ())) for name in ("discrepancy", "moment_errors")}
        return RepresentativePoints(**{**data, **arrays, **errors})
