"""One run to its responses along strain and its states: initial, peak, critical, and the small-strain probe."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from analysis import grading, micromechanics, stiffness, triaxial
from analysis.quantities import RESPONSES
from analysis.runfile import Run, RunFileError, read_snapshot

INDICES = ("I_G", "I_G_active", "I_G_stress")
#: A probe is checked against the static network if it can bring more than PUSHED of the contacts to the Coulomb limit
#: or its signs differ by more than ASYMMETRY, and gives way to it if it is off by more than OFF.  (Signs that agree and
#: contacts below the limit at rest prove nothing: where mu_s is near the friction of consolidation, G_0 was 27 to 61 %
#: too low with either.  With no more than PUSHED, 1,000 grains were off by 0.4 % at most.)
PUSHED, ASYMMETRY, OFF = 0.005, 0.05, 0.01
#: A snapshot stands for a strain if their logarithms differ by no more than NEAR, strains below START being alike.
NEAR, START = 0.5, 1e-3


@dataclass(frozen=True)
class RunStates:
    """What one run contributes: `responses` symbol -> (T,) over `eps_a` (T,), `states` state -> symbol -> value.

    `errors` holds standard errors of state values from the run's own fluctuation; `steady_end` says that the run
    stopped because its critical state was steady; `critical_from` (strain), `drift` (of eta and e over the critical
    part, relative) and `unsteady` (a reason, empty if the proof holds) say what the critical averages rest on;
    `grains` is (diameters (N,) m, grading attributes) of a shear run; `checks` what a probe was judged by, as
    `_probe_states` names it.
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
    checks: dict[str, float] = field(default_factory=dict)


def run_states(run: Run) -> RunStates:
    """Responses and states of a shear run, or the moduli of a probe run, all in SI units.

    A probe in which contacts slide gives way to the static solve of its contact network, the elastic stiffness.  The
    initial state is the record's row at zero strain, the peak that of the smoothed
    stress ratio, the critical state the average of the last part (`analysis.triaxial`).  Grading indices come from the
    snapshots: the first, the one nearest to the peak (NaN if none is near), the last.  Raises runfile.RunFileError if
    something needed is missing or not finite.
    """
    if run.stage == "probe":
        return _probe_states(run)
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


def contacts_pushed(run) -> float:
    """Share of contacts that the probe can bring to the Coulomb limit, |f_t| + k_t strain |branch| >= mu_s |f_n|.

    NaN without snapshot or friction, and where each grain has its own friction, which a snapshot does not keep.
    """
    if not run.snapshots or "mu_s" not in run.parameters or run.parameters.get("heterogeneity") == "grain":
        return np.nan
    s = read_snapshot(run, 0)
    f_n, f_t, branch = (np.linalg.norm(v, axis=1) for v in (s.f_n, s.f_t, s.branch))
    pushed = f_t + s.k_t * float(run.probe["strain"]) * branch >= float(run.parameters["mu_s"]) * f_n
    return float(np.mean(pushed & (f_n > 0)))


def _probe_states(run) -> RunStates:
    """Moduli of a probe, of the static network where contacts slide in it, and the checks that decided.

    checks: `asymmetry` of the signs, `pushed` (`contacts_pushed`) and `off`, G_0 of the probe over the network's less
    one, NaN where there was no reason to solve it or no snapshot.
    """
    moduli = {k: float(run.probe[k]) for k in ("G_0", "K_0") if k in run.probe}
    checks = {"asymmetry": probe_asymmetry(run.probe), "pushed": contacts_pushed(run), "off": np.nan}
    safe = checks["pushed"] <= PUSHED and not checks["asymmetry"] > ASYMMETRY
    if run.snapshots and "G_0" in moduli and not safe:
        network = stiffness.network_moduli(read_snapshot(run, 0))
        checks["off"] = moduli["G_0"] / network.G_0 - 1.0
        if abs(checks["off"]) > OFF:
            moduli = {"G_0": network.G_0, "K_0": network.K_0}
    return RunStates(states={"probe": moduli}, checks=checks)


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
