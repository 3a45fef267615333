"""Order of the points and their packings: every beginning of the order covers their range and uses the packings evenly.

A packing serves several points.  Its noise averages out over the points, and a regression can separate it from the
effect of the inputs, if the points of each packing represent the whole distribution.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

#: Sweeps in which the points of a block change their packings, and the number of points up to which they are made.
_SWEEPS, _SWEPT = 4, 2000


def nested_order(inputs: ArrayLike) -> np.ndarray:
    """Order (Q,) of points (Q, d) in which every first part covers their range.

    The order begins at the middle; each next point is the one farthest from those before it, in the standardised
    logarithms of the inputs.
    """
    z = _standardised(inputs)
    order = [int(np.argmin(np.sum(z**2, axis=1)))]
    away = np.sum((z - z[order[0]]) ** 2, axis=1)
    while len(order) < len(z):
        order.append(int(np.argmax(away)))
        away = np.minimum(away, np.sum((z - z[order[-1]]) ** 2, axis=1))
        away[order] = -1.0
    return np.array(order)


def deal(inputs: ArrayLike, packings: int) -> np.ndarray:
    """Packing (Q,), from 0 to min(packings, Q) - 1, of each of the points (Q, d).

    The points are taken in their nested order in blocks of as many points as there are packings; within a block every
    packing has one point.  Which one it has maximises the sum of the distances between the points of the same packing
    (anticlustering: Spaeth 1986, with distances instead of their squares), so that the points of every packing spread
    over the whole distribution.  For the points of one block this is an assignment problem; the blocks are solved one
    after the other and then again until nothing changes.
    """
    z, order = _standardised(inputs), nested_order(inputs)
    count = min(packings, len(z))
    dealt = np.full(len(z), -1)
    blocks = [order[k : k + count] for k in range(0, len(z), count)]
    dealt[blocks[0]] = np.arange(count)
    for sweep in range(_SWEEPS if len(z) <= _SWEPT else 1):
        before = dealt.copy()
        for block in blocks[1:] if count > 1 else ():
            dealt[block] = -1
            done = dealt >= 0
            apart = np.stack([np.bincount(dealt[done], gap, count) for gap in cdist(z[block], z[done])])
            _, dealt[block] = linear_sum_assignment(apart, maximize=True)
        if sweep and np.array_equal(before, dealt):
            break
    return np.maximum(dealt, 0)


def _standardised(inputs: ArrayLike) -> np.ndarray:
    """Logarithms (Q, d) of the inputs with mean 0 and standard deviation 1."""
    logs = np.log(np.asarray(inputs, float))
    return (logs - logs.mean(axis=0)) / np.maximum(logs.std(axis=0), 1e-12)
