"""The backbone of a packing, as bench_equal_spheres.py counts it."""

from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from bench_equal_spheres import backbone


def packing(N: int, *contacts: tuple[int, int, float]):
    """Of N grains; each contact is (grain, grain, normal force)."""
    ids = np.array([contact[:2] for contact in contacts])
    force = np.array([[0.0, 0.0, contact[2]] for contact in contacts])
    return SimpleNamespace(N=N, contact_ids=ids, f_n=force)


def test_grains_that_carry_nothing_are_taken_out_again_and_again():
    """Five grains that all touch, a chain of three that hangs on them, a grain on three weak contacts, a free one."""
    core = [(i, j, 1.0) for i, j in combinations(range(5), 2)]
    chain = [(4, 5, 1.0), (5, 6, 1.0), (6, 7, 1.0)]
    weak = [(8, 0, 1e-5), (8, 1, 1e-5), (8, 2, 1e-5)]
    for least in (2, 4):
        found = backbone(packing(10, *core, *chain, *weak), least)
        assert found == {"Z_backbone": 4.0, "rattlers": pytest.approx(0.5)}
    ring = [(k, (k + 1) % 6, 1.0) for k in range(6)]
    assert backbone(packing(6, *ring), 2) == {"Z_backbone": 2.0, "rattlers": 0.0}
