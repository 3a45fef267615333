"""Representative points with their probabilities: the one value that all parts of the project hand on.

Chosen by `select_points`, kept in points.csv, written to and read from results.h5, drawn in figures.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..errors_and_files import GrainScatterError
from ..inputs.variables import NEEDED, VARIABLES

if TYPE_CHECKING:
    import pandas as pd

#: Largest errors of the moments that a set of points may have without a warning: relative ones of means and standard
#: deviations, absolute ones of correlations.
MEAN_LIMIT, STD_LIMIT, CORRELATION_LIMIT = 0.01, 0.03, 0.03
#: Moments that a warning lists at most.
_LISTED = 6


class PointsError(GrainScatterError):
    """Representative points cannot be made or read as asked."""


class Point(NamedTuple):
    """One representative point: number, interparticle friction, particle shear modulus (Pa), probability.

    `further`: the values of the random variables beside these two, by symbol, in SI units.
    """

    id: int
    mu_s: float
    G_p: float
    probability: float
    further: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True)
class RepresentativePoints:
    """Points x (n, d) in SI units with probabilities (n,) that sum to 1.

    `names` are the symbols of the d columns of x, the random variables (default: mu_s and G_p; x1, x2, ... unless
    d = 2), and `constants` the values of the needed variables that are not random, by symbol.  `points[symbol]`,
    `points.mu_s` and `points.G_p` (Pa) give either kind as an array (n,).
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
    names: tuple[str, ...] = ()
    constants: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        x, probability = np.asarray(self.x, float), np.asarray(self.probability, float)
        number = np.asarray(self.id, int) if len(self.id) else np.arange(len(x))
        if x.ndim != 2 or probability.shape != (len(x),) or number.shape != (len(x),):
            raise PointsError(f"points {x.shape}, probabilities {probability.shape}, ids {number.shape} do not match")
        if len(x) and not (probability.min() >= 0.0 and abs(probability.sum() - 1.0) < 1e-9):
            raise PointsError(
                f"probabilities of {len(x)} points: least {probability.min():g}, sum {probability.sum():.12g}, not 1"
            )
        d = x.shape[1]
        names = tuple(self.names) or (NEEDED if d == len(NEEDED) else tuple(f"x{i + 1}" for i in range(d)))
        constants = {symbol: float(value) for symbol, value in self.constants.items()}
        if len({*names, *constants}) != d + len(constants):
            raise PointsError(f"points {x.shape} have the columns {', '.join(names)} and the constants {constants}")
        values = {"x": x, "probability": probability, "id": number, "names": names, "constants": constants}
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.x)

    def __iter__(self) -> Iterator[Point]:
        """The points one by one, as `Point`."""
        columns = (self.id.tolist(), self.mu_s.tolist(), self.G_p.tolist(), self.probability.tolist())
        further = [name for name in self.names if name not in NEEDED]
        values = zip(*(self[name].tolist() for name in further), strict=True)
        others = [dict(zip(further, row, strict=True)) for row in values]
        rows = zip(*columns, others or [{}] * len(self), strict=True)
        return (Point(*row) for row in rows)

    def __getitem__(self, name: str) -> np.ndarray:
        """One column (n,) by its name: id, probability, or a variable's symbol, random or constant (SI units)."""
        if name in self.names:
            return self.x[:, self.names.index(name)]
        if name in self.constants:
            return np.full(len(self), self.constants[name])
        if name in ("id", "probability"):
            return getattr(self, name)
        raise KeyError(f"points have no column {name!r}, only id, {', '.join(self.variables)}, probability")

    @property
    def n(self) -> int:
        """Number of points."""
        return len(self.x)

    @property
    def variables(self) -> tuple[str, ...]:
        """Symbols of all variables, random or constant, in the order of the registry."""
        return _ordered((*self.names, *self.constants))

    @property
    def mu_s(self) -> np.ndarray:
        """Interparticle friction (n,)."""
        return self["mu_s"]

    @property
    def G_p(self) -> np.ndarray:
        """Particle shear modulus (n,), Pa."""
        return self["G_p"]

    def moment_warnings(self) -> list[str]:
        """One line if moments differ from those of the joint distribution by more than a limit: which, how much.

        Of more than _LISTED moments those that exceed their limits most are listed.
        """
        names = self.names
        limits = [(f"mean of {name}", MEAN_LIMIT, ".1%") for name in names]
        limits += [(f"standard deviation of {name}", STD_LIMIT, ".1%") for name in names]
        pairs = [(one, two) for i, one in enumerate(names) for two in names[i + 1 :]]
        limits += [(f"correlation of {one} and {two}", CORRELATION_LIMIT, ".2f") for one, two in pairs]
        found = {
            f"{name} {error:+{form}} (limit {limit:{form}})": abs(error) / limit
            for (name, limit, form), error in zip(limits, self.moment_errors, strict=bool(self.moment_errors))
            if abs(error) > limit
        }
        listed = sorted(found, key=lambda line: -found[line])[:_LISTED]
        lost = [line for line in found if line in listed]
        if len(found) > len(lost):
            lost.append(f"and {len(found) - len(lost)} more")
        text = f"points: the {self.n} points do not carry all moments of the inputs; errors: {', '.join(lost)}"
        return [text] if lost else []

    def columns(self) -> dict[str, np.ndarray]:
        """Name -> column (n,): id, mu_s, G_p (Pa), further variables (SI units), probability, as in results.h5."""
        return {name: self[name] for name in ("id", *self.variables, "probability")}

    def to_frame(self) -> pd.DataFrame:
        """The points as a pandas DataFrame with the columns of `columns`."""
        import pandas as pd

        return pd.DataFrame(self.columns())

    def to_csv(self) -> str:
        """The text of points.csv; every number in full."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        columns = {name: [repr(value) for value in column.tolist()] for name, column in self.columns().items()}
        if "G_p" in columns:
            columns["G_p_GPa"] = [f"{value / 1e9:.4f}" for value in self.G_p.tolist()]
        header = _csv_columns(self.variables)
        writer.writerow(header)
        writer.writerows(zip(*(columns[name] for name in header), strict=True))
        return out.getvalue()

    @staticmethod
    def from_csv(
        text: str, names: tuple[str, ...] = NEEDED, constants: Mapping[str, float] | None = None
    ) -> RepresentativePoints:
        """The points in the text of a points.csv; `names` and `constants` as in the points that were written."""
        lines = list(csv.DictReader(io.StringIO(text)))
        try:
            x = np.array([[float(line[name]) for name in names] for line in lines]).reshape(-1, len(names))
            probability = np.array([float(line["probability"]) for line in lines])
            number = np.array([int(line["id"]) for line in lines], int)
            return RepresentativePoints(x, probability, id=number, names=tuple(names), constants=constants or {})
        except (KeyError, TypeError, ValueError) as error:
            wanted = ", ".join(_csv_columns(_ordered((*names, *(constants or {})))))
            raise PointsError(f"points.csv: not a table of {wanted} ({error})") from error

    def to_dict(self) -> dict:
        """A JSON-ready dictionary."""
        record = {name: getattr(self, name) for name in ("method", "seed", "nested")}
        arrays = {name: getattr(self, name).tolist() for name in ("x", "probability", "id")}
        lists = {name: list(getattr(self, name)) for name in ("discrepancy", "moment_errors", "names")}
        return record | arrays | lists | {"constants": dict(self.constants)}

    @staticmethod
    def from_dict(data: dict) -> RepresentativePoints:
        """The inverse of to_dict."""
        arrays = {name: np.array(data[name]) for name in ("x", "probability", "id") if name in data}
        lists = {name: tuple(data.get(name, ())) for name in ("discrepancy", "moment_errors", "names")}
        return RepresentativePoints(**{**data, **arrays, **lists})


def _ordered(symbols: tuple[str, ...]) -> tuple[str, ...]:
    """Symbols in the order of the registry, unknown ones at the end."""
    return tuple([s for s in VARIABLES if s in symbols] + [s for s in symbols if s not in VARIABLES])


def _csv_columns(variables: tuple[str, ...]) -> list[str]:
    """Columns of points.csv: id, each variable in SI units, G_p also in GPa, probability."""
    named = [name for symbol in variables for name in ((symbol, "G_p_GPa") if symbol == "G_p" else (symbol,))]
    return ["id", *named, "probability"]
