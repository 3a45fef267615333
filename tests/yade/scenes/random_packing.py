"""A small random packing in YADE, pressed and sheared, written with YADE's own answers about itself.

    yade -n -x -j1 random_packing.py ARRAYS.npz RESULT.npz

ARRAYS holds position (N, 3), radius (N,), edge, G_p, d_eps (M, 3, 3); RESULT gets particles, contacts and what YADE
computes from them (stress, fabric, particle stresses, coordination numbers), and the stress (M, 3, 3) that each small
strain along d_eps leaves, per unit strain.
"""

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
edge, G_p = float(given["edge"]), float(given["G_p"])
STRAIN, REST = 3e-6, 3000

grains = O.materials.append(FrictMat(young=2.4 * G_p, poisson=0.2, frictionAngle=math.atan(0.3), density=2670))
O.periodic = True
O.cell.hSize = Matrix3(edge, 0, 0, 0, edge, 0, 0, 0, edge)
for x, r in zip(given["position"], given["radius"], strict=True):
    O.bodies.append(utils.sphere(Vector3(*x), float(r), material=grains))
O.engines = [
    ForceResetter(),
    InsertionSortCollider([Bo1_Sphere_Aabb()]),
    InteractionLoop(
        [Ig2_Sphere_Sphere_ScGeom()], [Ip2_FrictMat_FrictMat_MindlinPhys()], [Law2_ScGeom_MindlinPhys_Mindlin()]
    ),
    NewtonIntegrator(damping=0.4),
]
O.dt = 0.5 * utils.PWaveTimeStep()


def deform(gradient, steps):
    O.cell.velGrad = gradient
    O.run(steps, True)


def matrix(m):
    return np.array([[m[i, j] for j in range(3)] for i in range(3)])


def after(d_eps):
    """Stress (3, 3) Pa, compression positive, when all is at rest again after a strain increment (3, 3)."""
    O.loadTmp()
    deform(Matrix3(*(-d_eps / (200 * O.dt)).ravel()), 200)
    deform(Matrix3.Zero, REST)
    return -matrix(utils.getStress())


rate = 2e-5 / O.dt
while utils.getStress().trace() / 3 > -5e4:
    deform(-rate * Matrix3.Identity, 50)
deform(Matrix3.Zero, 2000)
while utils.getStress()[2, 2] > -3e5:
    deform(0.1 * rate * Matrix3(0, 0.2, 0, 0, 0, 0, 0, 0, -1), 50)
deform(Matrix3.Zero, 1000)
while utils.unbalancedForce() > 1e-6:
    O.run(1000, True)
# The probes are to be elastic: no contact may slide, however close to sliding the loading has left it.
for c in O.interactions:
    c.phys.tangensOfFrictionAngle = 10.0
O.saveTmp()
before = after(np.zeros((3, 3)))
responses = np.array([(after(STRAIN * d) - before) / STRAIN for d in given["d_eps"]])
O.loadTmp()
# YADE moves the grains after it has computed their forces: a step without time brings both to the same positions.
O.dt = 1e-30
O.run(1, True)

h, position = matrix(O.cell.hSize), np.array([tuple(b.state.pos) for b in O.bodies])
out = {name: [] for name in ("contact_ids", "normal", "branch", "overlap", "f_n", "f_t", "k_n", "k_t")}
for c in O.interactions:
    branch = position[c.id2] + h @ np.array(tuple(c.cellDist), float) - position[c.id1]
    row = ((c.id1, c.id2), tuple(c.geom.normal), branch, c.geom.penetrationDepth)
    row += (tuple(c.phys.normalForce), tuple(c.phys.shearForce), c.phys.kn, c.phys.ks)
    for values, value in zip(out.values(), row, strict=True):
        values.append(value)
np.savez(
    result, position=position, radius=given["radius"], cell=h,
    stress=matrix(utils.getStress()), fabric=matrix(utils.fabricTensor()[0]),
    particle_stress=np.array([matrix(m) for m in utils.bodyStressTensors()]),
    responses=responses, Z=utils.avgNumInteractions(skipFree=False), Z_m=utils.avgNumInteractions(skipFree=True),
    **{name: np.array(values) for name, values in out.items()},
)  # fmt: skip
sys.stdout.flush()
os._exit(0)
