"""The case that the toy solvers answer, and its exact values."""

LENGTH, LOAD, MODULUS, THICKNESS = 2.0, 3.0, 1.2e6, 0.1
STIFFNESS = MODULUS * THICKNESS**3 / 12  # at nu = 0
CENTRE = 5 * LOAD * LENGTH**4 / (384 * STIFFNESS)  # Timoshenko & Woinowsky-Krieger, strip at nu = 0
ENERGY = LOAD**2 * LENGTH**5 / (240 * STIFFNESS)  # half the work of the load: q/2 times the integral of w

CASE = f"""
title = "Strip"
suites = ["toys"]
theory = "kirchhoff-love-linear"

[surface]
kind = "plane"
xi1 = [0, {LENGTH}]
xi2 = [0, 1]

[material]
youngs_modulus = {MODULUS}
poissons_ratio = 0.0
thickness = {THICKNESS}

[points]
middle = [{LENGTH / 2}, 0.5]

[[supports]]
name = "rests"
on = ["xi1_min", "xi1_max"]

[[loads]]
kind = "area"
vector = [0, 0, -{LOAD}]

[[quantities]]
name = "centre"
kind = "displacement"
primary = true
points = ["middle"]
direction = [0, 0, -1]

[[quantities]]
name = "energy"
kind = "strain_energy"

[[quantities]]
name = "membrane"
kind = "membrane_energy"
absolute = true
"""

SUITE = """
title = "Toys"

[[runs]]
solver = "toy"

[[runs]]
solver = "toy-noisy"
seeds = [0, 1, 2]

[[runs]]
solver = "toy"
label = "halved"
settings = { factor = 0.5 }
"""

REFERENCES = f"""
[[values]]
quantity = "centre"
role = "judge"
value = {CENTRE!r}
uncertainty = 1e-15
theory = "kirchhoff-love-linear"
origin = "closed form"
source = "timoshenko"

[[values]]
quantity = "centre"
role = "literature"
value = 0.00625
theory = "kirchhoff-love-linear"
origin = "handbook"
source = "handbook"

[[values]]
quantity = "centre"
role = "published"
value = 0.003
theory = "kirchhoff-love-linear"
origin = "a training"
source = "paper"
label = "halved"

[[values]]
quantity = "membrane"
role = "judge"
value = 0.0
theory = "kirchhoff-love-linear"
origin = "a plate's linear membrane strain under transverse load"
source = "timoshenko"
"""

TOLERANCES = {
    "toy": "[strip]\ncentre = 1e-9\nmembrane = { absolute = 1e-12 }\n",
    "toy-noisy": "[strip]\ncentre = 1e-6\n",
}
