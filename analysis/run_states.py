"""One run to its responses along strain and its states: initial, peak, critical, and the small-strain probe."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from analysis import grading, micromechanics, stiffness, triaxial
from analysis.quantities import RESPONSES
from analysis.runfile import Run, RunFileError, read_snapshot

INDICES = ("I_G", "I_G_active", "I_G_stress")
#: Largest difference of the two signs of a probe, and share of contacts at the Coulomb limit at rest, that still count
#: as elastic: where mu_s is below the friction of consolidation both signs can be too soft alike (once by 61 %).
SLIDING, AT_LIMIT = 0.05, 0.01
#: A snapshot stands for a strain if their logarithms differ by no more than NEAR, strains below START being alike.
NEAR, START = 0.5, 1e-3


@dataclass(frozen=True)
class RunStates:
    """What one run contributes: `responses` symbol -> (T,) over `eps_a` (T,), `states` state -> symbol -> value.

    `errors` holds standard errors of state values from the run's own fluctuation; `steady_end` says that the run
    stopped because its critical state was steady; `critical_from` (strain), `drift` (of eta and e over the critical
    part, relative) and `unsteady` (a reason, empty if the proof holds) say what the critical averages rest on;
    `grains` is (diameters (N,) m, grading attributes) of a shear run.
    """

    eps_a: np.ndarray = field(default_factory=lambda: np.empty(0))
    responses: dict[str, np.ndarray] = field(default_factory=dict)
    states: dict[str, dict[str, float]] = field(default_factory=dict)
    errors: dict[str, dict[str, float]] = field(default_factory=dict)
    steady_end: bool = False
    critical_from: float = np.nan
    unsteady: str = ""
    drift: dict[str, float] = field(default_factory=dict)
    grains: tuple[np.ndarray, dict] | None = None


def run_states(run: Run) -> RunStates:
    """Responses and states of a shear run, or the moduli of a probe run, all in SI units.

    A probe in which contacts slide (`slides`) gives way to the static solve of its contact
    network, the elastic stiffness.  The initial state is the record's row at zero strain, the peak that of the smoothed
    stress ratio, the critical state the average of the last part (`analysis.triaxial`).  Grading indices come from the
    snapshots: the first, the one nearest to the peak (NaN if none is near), the last.  Raises runfile.RunFileError if
    something needed is missing or not finite.
    """
    if run.stage == "probe":
        return RunStates(states={"probe": _moduli(run)})
    record = run.record
    strain, sigma = record["eps_a"], record["sigma"]
    principal = np.linalg.eigvalsh(record["Phi"])
    derived = {"eta": triaxial.stress_ratio(sigma), "Phi_dev": principal[:, -1] - principal[:, 0]}
    responses = {symbol: derived[symbol] if symbol in derived else record[symbol] for symbol in RESPONSES}
    p, q = triaxial.mean_stress(sigma), triaxial.deviator_stress(sigma)
    others = {**{k: v for k, v in responses.items() if k != "eta"}, "p": p, "q": q}
    try:
        peak = triaxial.peak_state(strain, responses["eta"], others=others)
        critical = triaxial.critical_state(strain, {"eta": responses["eta"], **others})
        slope = triaxial.dilatancy(strain, responses["eps_v"], p, q)
    except triaxial.TriaxialError as error:
        raise RunFileError(f"{run.path}: {error}") from error
    at_peak = {"eta": peak.eta, "eps_peak": peak.eps_a, "D_p": float(slope[peak.index])}
    states = {
        "initial": {symbol: float(values[0]) for symbol, values in {**responses, "p": p}.items()},
        "peak": at_peak | {symbol: float(value) for symbol, value in peak.values.items()},
        "critical": dict(critical.mean),
    }
    for state, strain_at in (("initial", 0.0), ("peak", peak.eps_a), ("critical", np.inf)):
        states[state] |= _grading_indices(run, strain_at)
    return RunStates(
        eps_a=strain, responses=responses, states=states, steady_end=run.attrs.get("exit_reason") == "steady",
        errors={"peak": {"eta": peak.eta_error}, "critical": dict(critical.error)}, grains=_grains(run),
        critical_from=critical.eps_from, unsteady=critical.reason,
        drift={symbol: critical.drift[symbol] for symbol in ("eta", "e")},
    )  # fmt: skip


def probe_asymmetry(probe) -> float:
    """Relative difference of the stiffnesses that the two signs of a probe give; large if contacts slide."""
    if not probe or "G_0_minus" not in probe:
        return np.nan
    return float(2 * abs(probe["G_0"] - probe["G_0_minus"]) / (probe["G_0"] + probe["G_0_minus"]))


def contacts_at_limit(run) -> float:
    """Share of contacts that stand at the Coulomb limit before the probe.

    NaN without snapshot or friction, and where each grain has its own friction, which a snapshot does not keep.
    """
    if not run.snapshots or "mu_s" not in run.parameters or run.parameters.get("heterogeneity") == "grain":
        return np.nan
    s = read_snapshot(run, 0)
    return micromechanics.sliding_fraction(s.f_n, s.f_t, float(run.parameters["mu_s"]))


def slides(asymmetry, at_limit):
    """Whether contacts slide in a probe (numbers or arrays), so that it does not give the elastic stiffness."""
    return (np.asarray(asymmetry) > SLIDING) | (np.asarray(at_limit) > AT_LIMIT)


def _moduli(run) -> dict[str, float]:
    """G_0 and K_0 of a probe; of the static network where contacts slide in it."""
    if run.snapshots and slides(probe_asymmetry(run.probe), contacts_at_limit(run)):
        moduli = stiffness.network_moduli(read_snapshot(run, 0))
        return {"G_0": moduli.G_0, "K_0": moduli.K_0}
    return {k: float(run.probe[k]) for k in ("G_0", "K_0") if k in run.probe}


def _grading_indices(run, strain):
    """Grading indices of the snapshot nearest to a strain (infinite: the last); NaN if none is near (`NEAR`)."""
    at = np.array([eps_a for _, eps_a, _ in run.snapshots])
    if len(at) and np.isinf(strain):
        strain = at[-1]
    gap = np.abs(np.log((at + START) / (strain + START)))
    if not len(at) or gap.min() > NEAR:
        return dict.fromkeys(INDICES, np.nan)
    k = int(np.argmin(gap))
    s = read_snapshot(run, k)
    diameter = 2 * s.radius
    count = micromechanics.contact_count(s.N, s.contact_ids)
    return {
        "I_G": grading.grading_index(diameter),
        "I_G_active": grading.active_grading_index(diameter, count),
        "I_G_stress": grading.stress_grading_index(diameter, micromechanics.particle_p_volume(s)),
    }


def _grains(run):
    if not run.snapshots:
        return None
    diameter = 2 * read_snapshot(run, 0).radius
    return diameter, {"d50": grading.size_at(diameter, 0.5), "I_G": grading.grading_index(diameter), "unit": "m"}
