"""What a run records: window averages along the strain, a history of samples, snapshots of grains and contacts."""

from __future__ import annotations

import math

import numpy as np
from yade import utils

from yade_scripts import rve
from yade_scripts.inertia import radii
from yade_scripts.material import contact_counts, solid_volume
from yade_scripts.rve import O

#: Sampled often; the window mean is recorded.
_SAMPLED = ("eps_a", "eps_v", "sigma", "cell", "e", "e_m", "Z", "Z_m", "Phi", "f_sliding", "I", "F_unb", "E_kinetic")
#: Taken at the window's end while energies are summed; NaN in the windows beyond.
_ENERGIES = ("E_elastic", "E_friction", "E_damping")


def window_edges(strain_end: float, windows: int | str = "default") -> np.ndarray:
    """Strains at which output windows end: 0.1 % steps to 1 %, 0.25 % to 5 %, 0.5 % beyond, or `windows` equal ones."""
    if windows != "default":
        return np.linspace(0.0, strain_end, int(windows) + 1)[1:]
    edges = np.concatenate([np.arange(1, 10) * 1e-3, 0.01 + np.arange(16) * 2.5e-3, np.arange(0.05, 2.5, 5e-3)])
    return np.append(edges[edges < strain_end - 1e-9], strain_end)


class State:
    """Momentary macroscopic state of the scene; everything a window averages."""

    def __init__(self, p):
        self.p, self.radius, self.V_s = p, radii(), solid_volume()
        self.volume = 4.0 / 3.0 * np.pi * self.radius**3
        self.V_0 = O.cell.volume

    def sample(self, rate: float) -> dict:
        """One sample of every sampled quantity; `rate` is the axial strain rate (1/s), for the inertial number."""
        sigma, V = rve.stress(), O.cell.volume
        counts = contact_counts()
        active = counts >= 2
        pressure = float(np.trace(sigma)) / 3.0
        return {
            "eps_a": -math.log(O.cell.trsf[2, 2]),
            "eps_v": math.log(self.V_0 / V),
            "sigma": sigma,
            "cell": np.array([O.cell.hSize[i, i] for i in range(3)]),
            "e": V / self.V_s - 1.0,
            "e_m": V / float(self.volume[active].sum()) - 1.0 if active.any() else math.inf,
            "Z": float(counts.mean()),
            "Z_m": (counts.sum() - np.sum(counts == 1)) / active.sum() if active.any() else 0.0,
            "Phi": _fabric(),
            "f_sliding": rve.contact_law().ratioSlidingContacts(),
            "I": rate * self.p.d50 * math.sqrt(self.p.rho / pressure) if pressure > 0 else math.inf,
            "F_unb": utils.unbalancedForce(),
            "E_kinetic": utils.kineticEnergy(),
        }


def _fabric() -> np.ndarray:
    tensor = utils.fabricTensor()[0] if len(O.interactions) else None
    return np.array([[tensor[i, j] for j in range(3)] for i in range(3)]) if tensor is not None else np.zeros((3, 3))


class History:
    """A consolidation's own record: one sample each two thousand steps, with the step number."""

    def __init__(self, p, period: int = 2000):
        self.state, self.period, self.rows = State(p), period, []

    def __call__(self) -> None:
        if not self.rows or O.iter - self.rows[-1]["steps"] >= self.period:
            row = self.state.sample(0.0)
            self.rows.append({"steps": O.iter, **{k: row[k] for k in ("sigma", "e", "e_m", "Z", "Z_m", "F_unb")}})

    def arrays(self) -> dict[str, np.ndarray]:
        return {key: np.array([row[key] for row in self.rows]) for key in self.rows[0]}


class Windows:
    """The record of a shear run: every sample goes into the mean of its strain window; nothing is a single step.

    `rows` holds the finished windows, row 0 the state before shear; `sums` the open one.  Both are plain data, so
    that a checkpoint can carry them: `to_dict` and `restore`.  `path` is what is held (`paths.py`).

    Energies are summed up to `energy_strain` only: they take a tenth of a step's instructions, and a step too large
    for its packing shows there or by its stress.
    """

    def __init__(self, p, path):
        self.p, self.path, self.state = p, path, State(p)
        self.edges = window_edges(p.strain_end, p.windows)
        self.energy_0 = self._energies() | {"E_kinetic": utils.kineticEnergy()}
        self.offset = {"E_friction": -self.energy_0["E_friction"], "E_damping": 0.0}
        self.work, self.last, self.balance = 0.0, None, None
        self.rows: list[dict] = []
        self._open()
        self.add()
        self._close()

    def add(self) -> dict:
        """Take one sample, close the window when its edge is passed, and return the sample."""
        sample = self.state.sample(self.path.rate)
        self._add_work(sample)
        error = self.path.error(sample)
        for key in _SAMPLED:
            self.sums[key] = self.sums[key] + sample[key]
        self.sums["servo_mean"] += self.path.mean_error(sample)
        self.servo_max = max(self.servo_max, abs(error))
        self.count += 1
        if self.rows and self.strain(sample) >= self.edges[len(self.rows) - 1]:
            self._close()
        return sample

    def strain(self, sample: dict) -> float:
        """Axial strain of a sample or row in the direction of the test, positive."""
        return self.path.sign * sample["eps_a"]

    def end(self) -> None:
        """Close the open window although its edge is not reached."""
        if self.count:
            self._close()

    def full(self) -> bool:
        return len(self.rows) > len(self.edges)

    def _open(self) -> None:
        self.sums, self.count, self.servo_max = dict.fromkeys((*_SAMPLED, "servo_mean"), 0.0), 0, 0.0

    def _close(self) -> None:
        row = {key: value / self.count for key, value in self.sums.items()}
        energies = dict.fromkeys(_ENERGIES, math.nan) if self.balance is not None else self._spent()
        self.rows.append(row | energies | {"W_boundary": self.work, "servo_max": self.servo_max})
        if self.balance is None and len(self.rows) > 1 and self.edges[len(self.rows) - 2] > self.p.energy_strain - 1e-9:
            self.balance = self.energy_balance()
            rve.contact_law().calcEnergy = O.trackEnergy = False
        self._open()

    def _add_work(self, sample: dict) -> None:
        """Boundary work by the trapezoidal rule on stress and logarithmic strains of the cell's axes."""
        now = (np.diag(sample["sigma"]) * O.cell.volume, np.array([math.log(O.cell.trsf[i, i]) for i in range(3)]))
        if self.last is not None:
            self.work -= float(0.5 * (now[0] + self.last[0]) @ (now[1] - self.last[1]))
        self.last = now

    def _energies(self) -> dict[str, float]:
        law = rve.contact_law()
        springs = ((spring.shearForce, spring.ks) for spring in (c.phys for c in O.interactions))
        tangential = sum(force.squaredNorm() / (2.0 * k) for force, k in springs if k > 0.0)
        damping = O.energy["nonviscDamp"] if "nonviscDamp" in dict(O.energy.items()) else 0.0
        return {
            "E_elastic": law.normElastEnergy() + tangential,
            "E_friction": law.frictionDissipation,
            "E_damping": damping,
        }

    def _spent(self) -> dict[str, float]:
        """The energies, friction and damping since the start of shear."""
        return {key: value + self.offset.get(key, 0.0) for key, value in self._energies().items()}

    def energy_balance(self) -> tuple[float, float]:
        """|boundary work - (elastic + kinetic + friction + damping)| over the work put in, and the strain it is of.

        That where the energies' sums ended, or before, that of the last row.  What the contact springs release counts
        as put in: a packing that loses its stress dissipates more than the work at its boundary.
        """
        if self.balance is not None:
            return self.balance
        end, start = self.rows[-1], self.energy_0
        spent = end["E_elastic"] - start["E_elastic"] + end["E_friction"] + end["E_damping"]
        spent += utils.kineticEnergy() - start["E_kinetic"]
        released = max(start["E_elastic"] - end["E_elastic"], 0.0)
        return abs(end["W_boundary"] - spent) / (abs(end["W_boundary"]) + released), self.strain(end)

    def arrays(self) -> dict[str, np.ndarray]:
        """Every recorded quantity as an array (T, ...)."""
        return {key: np.array([row[key] for row in self.rows]) for key in self.rows[0]}

    def to_dict(self) -> dict:
        keys = ("rows", "sums", "count", "servo_max", "work", "last", "energy_0", "balance")
        spent = self._spent()
        return {key: getattr(self, key) for key in keys} | {
            "spent": {key: spent[key] for key in self.offset}, "V_0": self.state.V_0, "path": self.path.to_dict()
        }  # fmt: skip

    def restore(self, saved: dict) -> None:
        """Take up the record of a checkpoint: the law's own energy counters restart at zero after a reload."""
        self.offset = saved.pop("spent")
        self.state.V_0 = saved.pop("V_0")
        self.path.restore(saved.pop("path"))
        vars(self).update(saved)


def snapshot(label: str, eps_a: float) -> dict:
    """All grains and contacts as plain arrays (shapes, units and signs: data/README.md, run files)."""
    h = np.array([[O.cell.hSize[i, j] for j in range(3)] for i in range(3)])
    position = np.array([tuple(b.state.pos) for b in O.bodies])
    rows = []
    for c in O.interactions:
        g, f = c.geom, c.phys
        branch = position[c.id2] + h @ np.array(tuple(c.cellDist), float) - position[c.id1]
        rows.append((c.id1, c.id2, *g.normal, *branch, g.penetrationDepth, *f.normalForce, *f.shearForce, f.kn, f.ks))
    data = np.array(rows, float).reshape(len(rows), 17)
    order = np.lexsort((data[:, 1], data[:, 0]))
    data = data[order]
    return {
        "label": label,
        "eps_a": float(eps_a),
        "position": position,
        "radius": radii(),
        "cell": h,
        "contact_ids": data[:, :2].astype(np.int64),
        "normal": data[:, 2:5],
        "branch": data[:, 5:8],
        "overlap": data[:, 8],
        "f_n": data[:, 9:12],
        "f_t": data[:, 12:15],
        "k_n": data[:, 15],
        "k_t": data[:, 16],
    }
