"""A campaign that is killed at random moments and started again, checked for losses and repetitions at every kill."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field

import h5py
import numpy as np
from campaign_cases import ROOT, Small, same_arrays

from analysis.runs.peak_critical import stress_ratio
from campaign.config import jobs

#: A run taken up from a checkpoint against the same run undisturbed: the largest mean difference along the strain, as a
#: share of the mean, that the scatter of packings of some hundred spheres explains.
SCATTER = {"eta": 0.10, "e": 0.02}


@dataclass
class Survived:
    """The number of kills, how often each run was interrupted, and the share of the work done at each kill."""

    kills: int = 0
    interrupted: Counter = field(default_factory=Counter)
    shares: list[float] = field(default_factory=list)


def kill_and_restart(small: Small, kills: int, rng: random.Random, longest: float) -> Survived:
    """SIGKILL the campaign's whole process group `kills` times, each time start it again, and let it end.

    A kill comes up to `longest` seconds (evenly distributed) after the runs finished or at work have reached a share of
    the predicted work that is drawn beforehand, so that the moments are spread over the campaign however slow the
    machine; the last share leaves a run for every place and one more (where the campaign still ends first, the kills
    are fewer).  AssertionError if a total in `status` changes, a finished product is lost or made again, or a finished
    run is started again.
    """
    cost = {row.run_id: row.cpu_seconds for row in small.rows}
    last = 1.0 - (jobs(small.config) + 1) * max(cost.values()) / sum(cost.values())
    survived = Survived()
    for share in [*sorted(rng.uniform(0.0, max(last, 0.1)) for _ in range(kills)), None]:
        before, sums = _stamps(small), small.sums()
        run = start(small)
        while share is not None and run.poll() is None and _share(cost, [*_done(small), *_at_work(small)]) < share:
            time.sleep(0.1)
        try:
            code = run.wait(timeout=rng.uniform(0.0, longest) if share is not None else None)
            assert code == 0, f"status {code} at the end: {small.status()['failures']}"
        except subprocess.TimeoutExpired:
            os.killpg(run.pid, signal.SIGKILL)
            run.wait()
            survived.kills += 1
            survived.shares.append(_share(cost, _done(small)))
            survived.interrupted.update(_at_work(small))
        _check(small, before, sums)
    return survived


def start(small: Small) -> subprocess.Popen:
    """`campaign run` in a process group of its own."""
    return subprocess.Popen(small.line("run", "--quiet"), env=small.env(), cwd=ROOT, start_new_session=True,
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # fmt: skip


def _check(small: Small, before: dict, sums: dict) -> None:
    """The total is the plan's, and whatever was finished at the last start is as it was, its log included."""
    counts = small.status()["counts"]["total"]
    states = sum(n for word, n in counts.items() if word != "total")
    assert counts["total"] == states == len(small.rows), counts
    now, changed = _stamps(small), {k: v for k, v in sums.items() if small.sums().get(k) != v}
    assert not changed, f"finished products lost or changed: {sorted(changed)}"
    again = [run_id for run_id, stamps in before.items() if now[run_id] != stamps]
    assert not again, f"finished runs started again: {again}"


def _stamps(small: Small) -> dict[str, list]:
    """Run id -> file number and time of product and log, for the finished runs; another start writes another log."""
    stamps = {}
    for row in small.rows:
        with suppress(FileNotFoundError):
            paths = (small.folder / row.product, small.folder / "logs" / f"{row.run_id}.log")
            stamps[row.run_id] = [(s.st_ino, s.st_mtime_ns) for s in (path.stat() for path in paths)]
    return stamps


def _share(cost: dict[str, float], run_ids: list[str]) -> float:
    """Share of the predicted work that these runs are."""
    return sum(cost[run_id] for run_id in run_ids) / sum(cost.values())


def _done(small: Small) -> list[str]:
    return [row.run_id for row in small.rows if (small.folder / row.product).exists()]


def _at_work(small: Small) -> list[str]:
    """Runs without a product whose lock is there; after a kill, those that it interrupted, for their locks stay."""
    locks = {path.name[1:].removesuffix(".lock") for path in (small.folder / "products").glob(".*.lock")}
    return [row.run_id for row in small.rows if row.run_id in locks and not (small.folder / row.product).exists()]


def compare(whole: Small, killed: Small, interrupted: Counter) -> dict[str, int | float]:
    """Products of the killed campaign against the undisturbed one's, by what happened to them.

    Returns for "untouched" and "begun_anew" runs how many there are and how many agree to the last bit (for both, all
    must), for those "resumed" from a checkpoint their number and the worst difference (to be held against SCATTER).
    """
    counts = dict.fromkeys(("untouched", "untouched_identical", "begun_anew", "begun_anew_identical", "resumed"), 0)
    counts |= {f"resumed_{name}_difference": 0.0 for name in SCATTER}
    for row in whole.rows:
        with h5py.File(whole.folder / row.product) as a, h5py.File(killed.folder / row.product) as b:
            if b.attrs["resumed"]:
                counts["resumed"] += 1
                for name, difference in _differences(a, b).items():
                    counts[f"resumed_{name}_difference"] = max(counts[f"resumed_{name}_difference"], difference)
                continue
            fate = "begun_anew" if row.run_id in interrupted else "untouched"
            counts[fate] += 1
            counts[f"{fate}_identical"] += same_arrays(a, b)
    return counts


def _differences(a: h5py.File, b: h5py.File) -> dict[str, float]:
    """Mean difference along the strain beyond 1 % (below, eta is small) over the mean, for eta and e."""
    (strain, *curves), (strain_b, *others) = (
        (f["record/eps_a"][()], stress_ratio(f["record/sigma"][()]), f["record/e"][()]) for f in (a, b)
    )
    late = strain > 0.01
    return {
        name: float(np.mean(np.abs(np.interp(strain[late], strain_b, other) - curve[late])) / np.mean(curve[late]))
        for name, curve, other in zip(SCATTER, curves, others, strict=True)
    }
