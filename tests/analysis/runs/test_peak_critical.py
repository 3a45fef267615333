"""States of a triaxial record: strains, peak, critical state with its proof, dilatancy."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import lfilter
from scipy.special import stdtrit

from analysis.runs import peak_critical

STRAIN = np.arange(0, 401) * 1e-3


def curve(strain, peak=0.4, at=0.04):
    """Stress ratio of a dense packing: steep rise, peak, softening to 0.65."""
    return 0.65 * (1.0 - np.exp(-strain / 0.003)) + peak * strain / at * np.exp(1.0 - strain / at)


def correlated(rng, rows=401, length=0.015):
    """Noise of unit variance that forgets itself over `length` of strain."""
    a = np.exp(-1e-3 / length)
    return lfilter([np.sqrt(1 - a * a)], [1, -a], rng.normal(size=rows + 500))[500:]


def test_stress_ratio_of_a_tensor():
    sigma = np.array([np.diag([90.0, 110.0, 250.0]), np.diag([100.0, 100.0, 100.0])])
    assert peak_critical.mean_stress(sigma).tolist() == [150.0, 100.0]
    assert peak_critical.deviator_stress(sigma).tolist() == [150.0, 0.0]
    assert peak_critical.stress_ratio(sigma).tolist() == [1.0, 0.0]


def test_tensor_strain_forgets_rotation_and_is_exact_when_large():
    rng = np.random.default_rng(1)
    strain = rng.normal(scale=0.3, size=(3, 3))
    strain = 0.5 * (strain + strain.T)
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    cell = rng.normal(size=(3, 3)) + 3 * np.eye(3)
    assert peak_critical.deformation_strain(cell, expm(-strain) @ cell) == pytest.approx(strain, abs=1e-12)
    assert peak_critical.deformation_strain(Q @ cell, expm(-strain) @ cell) == pytest.approx(strain, abs=1e-12)
    edges = np.array([[1.0, 1.0, 1.0], [1.05, 1.04, 0.8]])
    assert peak_critical.deformation_strain(*map(np.diag, edges))[2, 2] == pytest.approx(-np.log(0.8))


@pytest.mark.parametrize("at", [0.02, 0.04, 0.08])
def test_smooth_curve_keeps_its_peak(at):
    true = curve(np.linspace(0, 0.4, 40001), at=at)
    peak = peak_critical.peak_state(STRAIN, curve(STRAIN, at=at), others={"twice": 2 * curve(STRAIN, at=at)})
    assert peak.eta == pytest.approx(true.max(), rel=1e-3)
    assert peak.eps_a == pytest.approx(np.argmax(true) * 1e-5, abs=2e-3)
    assert peak.values["twice"] == pytest.approx(2 * peak.eta, rel=1e-12) and STRAIN[peak.index] == peak.eps_a


def test_noise_does_not_lift_the_peak():
    rng = np.random.default_rng(2)
    true = curve(np.linspace(0, 0.4, 40001)).max()
    peaks = [peak_critical.peak_state(STRAIN, curve(STRAIN) + 0.02 * rng.normal(size=401)) for _ in range(40)]
    eta = np.array([peak.eta for peak in peaks])
    assert eta.mean() == pytest.approx(true, rel=0.005)
    assert np.max(curve(STRAIN) + 0.02 * rng.normal(size=401)) > 1.02 * true  # what the plain maximum would say


def test_correlated_noise_is_in_the_error_of_the_peak():
    rng = np.random.default_rng(7)
    peaks = [peak_critical.peak_state(STRAIN, curve(STRAIN) + 0.02 * correlated(rng)) for _ in range(60)]
    assert np.mean([p.eta_error for p in peaks]) == pytest.approx(np.std([p.eta for p in peaks]), rel=0.3)


def test_neither_the_elastic_rise_nor_the_end_of_the_record_is_the_peak():
    strain = np.concatenate([np.arange(10) * 1e-3, 0.01 + np.arange(16) * 2.5e-3, np.arange(0.05, 0.4, 5e-3)])
    rise = 1.0 - np.exp(-strain / 0.0007) - 0.15 * np.exp(-((strain - 0.02) ** 2) / 2e-4)
    flat = peak_critical.peak_state(strain, rise)
    assert 0.99 < flat.eta < 1.005 * rise.max() and flat.eps_a >= 0.01
    wild = rise + np.where(strain > 0.385, 0.1, 0.0)
    assert peak_critical.peak_state(strain, wild).eta < 1.03


def test_smoothing_leaves_parabolas_alone_and_takes_tensors():
    y = np.stack([3 - STRAIN + 20 * STRAIN**2, STRAIN], axis=1)
    assert peak_critical.smooth(STRAIN, y, 0.03) == pytest.approx(y, abs=1e-9)


def test_steady_part_has_its_mean_and_error():
    rng = np.random.default_rng(3)
    inside, steady, refuted = [], [], []
    for _ in range(300):
        c = peak_critical.critical_state(STRAIN, {"eta": 0.65 + 0.023 * correlated(rng), "e": 0.64 + 0.0 * STRAIN})
        inside.append(abs(c.mean["eta"] - 0.65) < stdtrit(c.blocks - 2, 0.975) * c.error["eta"])
        refuted.append("drifts by" in c.reason)
        quiet = {"eta": 0.65 + 0.008 * correlated(rng), "e": 0.64 + 0.0 * STRAIN}
        steady.append(peak_critical.critical_state(STRAIN, quiet).steady)
    assert 0.84 <= np.mean(inside) <= 0.99
    assert np.mean(steady) > 0.85 and np.mean(refuted) < 0.1
    assert (c.eps_from, c.eps_to, c.blocks) == (0.25, 0.4, 5)


def test_drift_is_measured_and_refused():
    e = 0.6 + 0.2 * STRAIN
    c = peak_critical.critical_state(STRAIN, {"eta": 0.65 + 0 * STRAIN, "e": e})
    assert not c.steady and "e drifts by +4.48%" in c.reason and "limit 1.0%" in c.reason
    assert c.drift["e"] == pytest.approx(0.2 * 0.149 / c.mean["e"], rel=1e-3)
    assert c.mean["e"] == pytest.approx(e[251:].mean(), rel=1e-12)
    assert peak_critical.critical_state(STRAIN, {"e": e}, tolerance={"e": 0.06}).steady


def test_scatter_is_relative_and_free_of_drift():
    rng = np.random.default_rng(4)
    noise = 0.01 * rng.normal(size=401)
    c = peak_critical.critical_state(STRAIN, {"eta": 0.5 + 0.1 * STRAIN + noise})
    assert c.scatter["eta"] == pytest.approx(0.01 / c.mean["eta"], rel=0.15)


def test_a_drift_lost_in_scatter_proves_nothing():
    rng = np.random.default_rng(5)
    c = peak_critical.critical_state(STRAIN[:301], {"eta": 0.5 + 0.1 * correlated(rng)[:301]})
    assert not c.steady and "eta's drift over 0.25-0.3 is known to" in c.reason and c.drift_error["eta"] > 0.05


def test_a_flat_noisy_curve_is_overestimated_less_than_by_a_narrow_fit():
    rng = np.random.default_rng(6)
    flat = [0.5 + 0.01 * correlated(rng) for _ in range(20)]
    wide, narrow = (np.mean([peak_critical.peak_state(STRAIN, y, width).eta for y in flat]) for width in (0.08, 0.02))
    assert 0.5 < wide < narrow - 0.002


def test_short_test_is_kept_and_marked():
    c = peak_critical.critical_state(STRAIN[:201], {"eta": 0.65 + 0 * STRAIN[:201]})
    assert not c.steady and "ends at eps_a = 0.2, less than a block of 0.03 past 0.25" in c.reason
    assert c.mean["eta"] == pytest.approx(0.65) and c.eps_from == pytest.approx(0.12)
    assert peak_critical.critical_state(STRAIN[:301], {"eta": 0.65 + 0 * STRAIN[:301]}).steady


def test_dilatancy_takes_the_elastic_parts_off():
    # Built from plastic dilatancy D: d eps_v = -D d eps_q^p + dp / K with d eps_q = d eps_q^p + dq / 3G.
    K, G, D = 200e6, 150e6, 0.4
    q = 1e5 * (1 - np.exp(-STRAIN / 0.05))
    p = 1e5 + q / 3
    eps_a = STRAIN
    dp, dq = np.gradient(p, STRAIN), np.gradient(q, STRAIN)
    # eps_a = eps_q + eps_v / 3, so 1 = (x + dq / 3G) + (-D x + dp / K) / 3 for x = d eps_q^p / d eps_a.
    x = (1 - dq / (3 * G) - dp / (3 * K)) / (1 - D / 3)
    slope = -D * x + dp / K
    eps_v = np.concatenate([[0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * np.diff(STRAIN))])
    D_p = peak_critical.dilatancy(eps_a, eps_v, p, q, K, G)
    assert D_p[20:-5] == pytest.approx(D, abs=2e-4)
    bare = peak_critical.dilatancy(eps_a, eps_v, p, q)
    assert abs(bare[20] - D) > 5 * abs(D_p[20] - D)


def test_undrained_shear_has_no_dilatancy():
    q = 1e5 * STRAIN
    assert peak_critical.dilatancy(STRAIN, 0 * STRAIN, 1e5 + q / 3, q)[50:] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("strain", "eta", "words"),
    [
        (STRAIN[:4], STRAIN[:4], "4 rows of record are too few"),
        (STRAIN[::-1], STRAIN, "strain does not increase after row 0"),
        (STRAIN, np.where(STRAIN == 0.1, np.nan, 1.0), "1 not finite"),
        (STRAIN, STRAIN[:9], "record of 9 rows against 401 strains"),
    ],
)
def test_broken_records_are_refused(strain, eta, words):
    with pytest.raises(peak_critical.TriaxialError, match=words):
        peak_critical.peak_state(strain, eta)
    with pytest.raises(peak_critical.TriaxialError, match=words):
        peak_critical.critical_state(strain, {"eta": eta})
