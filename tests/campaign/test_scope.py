"""What the tool does not do: keys that ask for it get that answer, and no key that there is or will be gets it."""

from dataclasses import fields

import pytest

from analysis.inputs.column_names import COLUMN_NAMES
from campaign.__main__ import main
from campaign.config_keys import SECTIONS, Slurm
from campaign.scope import _ANSWERS, SCOPE, out_of_scope


@pytest.mark.parametrize("key, words", [
    ("rolling_friction", "rolling"), ("mu_r", "rolling"), ("cohesion", "cohesion"), ("bond_strength", "bonds"),
    ("crushing", "crushing"), ("grain_crushing", "crushing"), ("shape", "spheres"), ("aspect_ratio", "spheres"),
    ("shape_factor", "spheres"), ("Sphericity", "spheres"), ("cyclic", "cyclic"), ("n_cycles", "cyclic"),
    ("water", "water"), ("water-content", "water"), ("saturation", "partial saturation"), ("suction", "water"),
    ("temperature", "heat"), ("wall", "walls"), ("wall_friction", "walls"), ("creep", "creep"),
    ("gravity", "gravity"), ("true_triaxial", "other tests"), ("restitution", "damping"),
])  # fmt: skip
def test_a_key_that_asks_for_what_is_not_done_gets_that_answer(key, words):
    assert words in out_of_scope(key) and out_of_scope(key).startswith("the tool does not do ")


def test_no_key_and_no_planned_key_is_out_of_scope():
    keys = [key.name for kind in (*SECTIONS.values(), Slurm) for key in fields(kind)]
    planned = ["path", "direction", "undrained", "drained", "constant_p", "extension", "compression", "sieve", "family",
               "variables", "dependence", "copula", "measure", "pairs_behind", "steady", "liquefied"]  # fmt: skip
    names = [*SECTIONS, *keys, *COLUMN_NAMES, *planned, "G", "E", "wall_time", "strain_ends", ""]
    assert [name for name in names if out_of_scope(name)] == []


def test_the_help_says_it_in_five_lines(capsys):
    with pytest.raises(SystemExit) as end:
        main(["--help"])
    assert end.value.code == 0 and SCOPE in capsys.readouterr().out
    assert len(SCOPE.splitlines()) == 6 and max(map(len, SCOPE.splitlines())) <= 120
    assert all(word == word.lower() and " " not in word for word in _ANSWERS)
