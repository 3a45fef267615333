"""Face-centred cubic array of Hertz-Mindlin spheres in YADE: elastic constants from small strains of the cell.

    yade -n -x -j1 fcc_probe.py ARRAYS.npz RESULT.json

ARRAYS holds position (N, 3), radius, edge, G_p, nu, strain; RESULT gets K, C44, C_prime (Pa) and the pressure.
"""

import json
import math
import os
import sys

import numpy as np
from minieigenHP import Matrix3, Vector3
from yade import utils
from yade.wrapper import (
    Bo1_Sphere_Aabb,
    ForceResetter,
    FrictMat,
    Ig2_Sphere_Sphere_ScGeom,
    InsertionSortCollider,
    InteractionLoop,
    Ip2_FrictMat_FrictMat_MindlinPhys,
    Law2_ScGeom_MindlinPhys_Mindlin,
    NewtonIntegrator,
    Omega,
)

O = Omega()  # noqa: E741  YADE's own name for its scene

arrays, result = sys.argv[-2:]
given = np.load(arrays)
edge, strain = float(given["edge"]), float(given["strain"])
G_p, nu = float(given["G_p"]), float(given["nu"])
STEPS = 50

grains = O.materials.append(FrictMat(young=2 * G_p * (1 + nu), poisson=nu, frictionAngle=math.atan(10.0), density=2670))
O.periodic = True
O.cell.hSize = Matrix3(edge, 0, 0, 0, edge, 0, 0, 0, edge)
for x in given["position"]:
    O.bodies.append(utils.sphere(Vector3(*x), float(given["radius"]), material=grains))
O.engines = [
    ForceResetter(),
    InsertionSortCollider([Bo1_Sphere_Aabb()]),
    InteractionLoop(
        [Ig2_Sphere_Sphere_ScGeom()], [Ip2_FrictMat_FrictMat_MindlinPhys()], [Law2_ScGeom_MindlinPhys_Mindlin()]
    ),
    NewtonIntegrator(damping=0.0),
]
O.dt = 0.02 * utils.PWaveTimeStep()
O.run(2, True)
O.saveTmp()


def stress():
    sigma = utils.getStress()
    return -np.array([[sigma[i, j] for j in range(3)] for i in range(3)])


def response(d_eps):
    """Stress change over a strain (3, 3), compression positive, the mean of both signs."""
    change = []
    for sign in (1.0, -1.0):
        O.loadTmp()
        O.run(1, True)
        before = stress()
        O.cell.velGrad = Matrix3(*(-sign * strain * d_eps / (STEPS * O.dt)).ravel())
        O.run(STEPS, True)
        O.cell.velGrad = Matrix3.Zero
        O.run(1, True)
        change.append(sign * (stress() - before) / strain)
    return 0.5 * (change[0] + change[1])


shear = np.zeros((3, 3))
shear[0, 1] = shear[1, 0] = 0.5
answer = {
    "p": float(np.trace(stress())) / 3,
    "K": float(np.trace(response(np.eye(3) / 3))) / 3,
    "C44": float(response(shear)[0, 1]),
    "C_prime": float(response(np.diag([0.5, -0.5, 0.0])) @ [1, 0, 0] @ [1, 0, 0]),
}
with open(result, "w") as out:
    json.dump(answer, out)
sys.stdout.flush()
os._exit(0)
