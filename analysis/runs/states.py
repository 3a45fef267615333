"""Responses of one run along strain and its states: initial, peak, critical, and the small-strain probe."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..micromechanics import grading, metrics, stiffness
from ..quantities import DRAINED, EARLY_ENDS, Loading, responses_of
from . import peak_critical, undrained
from .run_file import Run, RunFileError, read_snapshot

INDICES = ("I_G", "I_G_active", "I_G_stress")
#: A probe is compared with the static network if it can bring more than the share PUSHED of the contacts to the Coulomb
#: limit, or if the results of its two signs differ by more than ASYMMETRY.  If the probe then differs from the network
#: by more than OFF, the network's moduli are used.  (Equal results of both signs, or contacts below the limit at rest,
#: are no proof: where mu_s is near the friction of consolidation, G_0 was 27 to 61 % too low in spite of them.  With at
#: most PUSHED, the error of 1,000 grains was 0.4 % at most.)
PUSHED, ASYMMETRY, OFF = 0.005, 0.05, 0.01
#: A snapshot represents a strain if their logarithms differ by at most NEAR; START is added to both strains first.
NEAR, START = 0.5, 1e-3
#: Rows of a record below which an early end leaves no state but the initial one.
FEWEST_ROWS = 5


@dataclass(frozen=True)
class RunStates:
    """Results of one run: `responses` symbol -> (T,) over `eps_a` (T,), `states` state -> symbol -> value, in SI units.

    `errors` holds standard errors of state values from the fluctuation of the run.  `steady_end`: the run stopped
    because its critical state was steady.  `critical_from` is the strain at which the critical part begins, `drift` the
    relative drift of eta and e over it, and `unsteady` the reason why it is not steady (empty if it is).  `grains` is
    (diameters (N,) m, grading attributes) of a shear run.  `checks` are the numbers by which a probe is judged; see
    `_probe_states`.  `loading` is the test of a shear run; `end` states that an undrained one "liquefied" or became
    "stiff", at the strain `end_strain`, before its end ("" otherwise).  `eps_a` is positive in extension, too, and ends
    where a test liquefied.
    """

    eps_a: np.ndarray = field(default_factory=lambda: np.empty(0))
    responses: dict[str, np.ndarray] = field(default_factory=dict)
    states: dict[str, dict[str, float]] = field(default_factory=dict)
    errors: dict[str, dict[str, float]] = field(default_factory=dict)
    steady_end: bool = False
    critical_from: float = np.nan
    unsteady: str = ""
    drift: dict[str, float] = field(default_factory=dict)
    grains: tuple[np.ndarray, dict[str, Any]] | None = None
    checks: dict[str, float] = field(default_factory=dict)
    loading: Loading = DRAINED
    end: str = ""
    end_strain: float = np.nan


def run_states(run: Run) -> RunStates:
    """Responses and states of a shear run, or the moduli of a probe run, all in SI units.

    The initial state is the row of the record at zero strain, the peak state that of the smoothed stress ratio (of its
    negative in extension), the critical state the average over the last part (see `peak_critical`); for the further
    states of undrained tests see `undrained`.  Grading indices come from the first snapshot, the one nearest to the
    peak (NaN if none is near) and the last one.  Quantities of states that a test did not reach, because it liquefied
    or became stiff before, are NaN.  If contacts slide in a probe, its moduli are replaced by those of the static solve
    of the contact network.
    Raises run_file.RunFileError if something needed is missing or not finite.
    """
    if run.stage == "probe":
        return _probe_states(run)
    loading, kept, end = run.loading, slice(run.rows_before_end), str(run.attrs.get("exit_reason", ""))
    strain, sigma = run.strain[kept], run.record["sigma"][kept]
    principal = np.linalg.eigvalsh(run.record["Phi"][kept])
    p, q = peak_critical.mean_stress(sigma), peak_critical.deviator_stress(sigma)
    derived = {"eta": peak_critical.stress_ratio(sigma), "Phi_dev": principal[:, -1] - principal[:, 0], "p": p, "q": q}
    if loading.is_undrained:
        derived |= undrained.pore_pressure(sigma, float(run.parameters["sigma_3"]))
    responses = {symbol: derived[symbol] if symbol in derived else run.record[symbol][kept]
                 for symbol in responses_of(loading.path)}  # fmt: skip
    ended = end if loading.is_undrained and end in EARLY_ENDS else ""
    try:
        states, errors, critical = _shear_states(strain, responses, p, q, loading, ended)
    except peak_critical.TriaxialError as error:
        raise RunFileError(f"{run.path}: {error}") from error
    places = {"initial": 0.0, "peak": states["peak"].get("eps_peak", np.nan)} | ({} if ended else {"critical": np.inf})
    for state, strain_at in places.items():
        states[state] |= _grading_indices(run, strain_at, strain[-1] if ended else np.inf)
    ends_at = float(run.attrs.get("liquefied_from", strain[-1])) if ended else np.nan
    ended_words = f"the test {EARLY_ENDS[ended]} at eps_a = {ends_at:.3g}" if ended else ""
    return RunStates(
        eps_a=strain,
        responses=responses,
        states=states,
        errors=errors,
        steady_end=end == "steady",
        critical_from=critical.eps_from if critical else np.nan,
        unsteady=critical.reason if critical else ended_words,
        drift={symbol: critical.drift[symbol] if critical else np.nan for symbol in loading.steady},
        grains=_grains(run),
        loading=loading,
        end=ended,
        end_strain=ends_at,
    )


def _shear_states(
    strain: np.ndarray, responses: Mapping[str, np.ndarray], p: np.ndarray, q: np.ndarray, loading: Loading, ended: str
) -> tuple[dict[str, dict[str, float]], dict[str, dict[str, float]], peak_critical.CriticalState | None]:
    """States, their standard errors, and the critical state of curves (T,); None if the test ended before it.

    A test that ended early has a peak only if its stress ratio fell again before.
    """
    others = {**{k: v for k, v in responses.items() if k != "eta"}, "p": p, "q": q}
    states = {"initial": {symbol: float(values[0]) for symbol, values in {**responses, "p": p}.items()}}
    critical = None
    if ended and len(strain) < FEWEST_ROWS:
        states |= {"peak": _nothing("eta", "eps_peak", *others), "critical": _nothing("eta", *others)}
        states |= {"transformation": _nothing("eps_pt", "p", "eta"), "strength": _nothing("q", "p", "eta", "u", "s_u")}
        return states, {}, critical
    peak = peak_critical.peak_state(strain, loading.sign * responses["eta"], others=others)
    at_peak = {"eta": loading.sign * peak.eta, "eps_peak": peak.eps_a}
    if "eps_v" in responses:
        slope = peak_critical.dilatancy(strain, responses["eps_v"], p, q, sign=loading.sign)
        at_peak["D_p"] = float(slope[peak.index])
    states["peak"] = at_peak | {symbol: float(value) for symbol, value in peak.values.items()}
    errors = {"peak": {"eta": peak.eta_error}}
    if ended:
        last = np.flatnonzero(peak_critical.admissible(strain, peak_critical.local_fits(strain)[1]))[-1]
        if peak.index == last:
            states["peak"], errors = _nothing(*states["peak"]), {}
        states["critical"] = _nothing("eta", *others)
    else:
        critical = peak_critical.critical_state(strain, {"eta": responses["eta"], **others}, tolerance=loading.steady)
        states["critical"], errors["critical"] = dict(critical.mean), dict(critical.error)
    if loading.is_undrained:
        states["transformation"] = undrained.transformation(strain, p, responses["eta"])
        states["strength"] = undrained.strength(strain, responses, loading.sign)
    return states, errors, critical


def _nothing(*symbols: str) -> dict[str, float]:
    """A state that was not reached."""
    return dict.fromkeys(symbols, np.nan)


def probe_asymmetry(probe: Mapping[str, Any] | None) -> float:
    """Relative difference of G_0 between the two signs of a probe, large if contacts slide; NaN without both signs."""
    if not probe or "G_0_minus" not in probe:
        return np.nan
    return float(2 * abs(probe["G_0"] - probe["G_0_minus"]) / (probe["G_0"] + probe["G_0_minus"]))


def contacts_pushed(run: Run) -> float:
    """Share of contacts that a probe can bring to the Coulomb limit, |f_t| + k_t strain |branch| >= mu_s |f_n|.

    NaN without a snapshot or friction, and where every grain has its own friction, which a snapshot does not contain.
    """
    if not run.snapshots or "mu_s" not in run.parameters or run.parameters.get("heterogeneity") == "grain":
        return np.nan
    s = read_snapshot(run, 0)
    f_n, f_t, branch = (np.linalg.norm(v, axis=1) for v in (s.f_n, s.f_t, s.branch))
    assert run.probe is not None  # read_run refuses a probe run without its group
    pushed = f_t + s.k_t * float(run.probe["strain"]) * branch >= float(run.parameters["mu_s"]) * f_n
    return float(np.mean(pushed & (f_n > 0)))


def _probe_states(run: Run) -> RunStates:
    """Moduli of a probe, or of the static network where contacts slide in it, and the checks that decided.

    checks: `asymmetry` (`probe_asymmetry`), `pushed` (`contacts_pushed`) and `off`, the relative difference of G_0 of
    the probe from that of the network; NaN if the network was not solved.
    """
    assert run.probe is not None  # read_run refuses a probe run without its group
    moduli: dict[str, float] = {k: float(run.probe[k]) for k in ("G_0", "K_0") if k in run.probe}
    checks = {"asymmetry": probe_asymmetry(run.probe), "pushed": contacts_pushed(run), "off": np.nan}
    safe = checks["pushed"] <= PUSHED and not checks["asymmetry"] > ASYMMETRY
    if run.snapshots and "G_0" in moduli and not safe:
        network = stiffness.network_moduli(read_snapshot(run, 0))
        checks["off"] = moduli["G_0"] / network.G_0 - 1.0
        if abs(checks["off"]) > OFF:
            moduli = {"G_0": network.G_0, "K_0": network.K_0}
    return RunStates(states={"probe": moduli}, checks=checks)


def _grading_indices(run: Run, strain: float, largest: float = np.inf) -> dict[str, float]:
    """Grading indices of the snapshot nearest to a strain (infinite: the last one), none beyond the strain `largest`.

    NaN if none is near (`NEAR`), or if the strain is not known.
    """
    strains = run.loading.sign * np.array([eps_a for _, eps_a, _ in run.snapshots])
    if len(strains) and np.isinf(strain):
        strain = strains[-1]
    gap = np.where(strains <= largest, np.abs(np.log((strains + START) / (strain + START))), np.inf)
    if not len(strains) or not gap.min() <= NEAR:
        return dict.fromkeys(INDICES, np.nan)
    k = int(np.argmin(gap))
    s = read_snapshot(run, k)
    diameter = 2 * s.radius
    count = metrics.contact_count(s.N, s.contact_ids)
    return {
        "I_G": grading.grading_index(diameter),
        "I_G_active": grading.active_grading_index(diameter, count),
        "I_G_stress": grading.stress_grading_index(diameter, metrics.particle_p_volume(s)),
    }


def _grains(run: Run) -> tuple[np.ndarray, dict[str, Any]] | None:
    """Diameters (N,) m of the first snapshot and attributes of their grading; None without a snapshot."""
    if not run.snapshots:
        return None
    diameter = 2 * read_snapshot(run, 0).radius
    return diameter, {"d50": grading.size_at(diameter, 0.5), "I_G": grading.grading_index(diameter), "unit": "m"}
