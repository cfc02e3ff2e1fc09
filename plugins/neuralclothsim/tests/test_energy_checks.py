"""The energies that the released NeuralClothSim gives, on a clone that NEURALCLOTHSIM names."""

import math
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

CLONE = os.environ.get("NEURALCLOTHSIM", "")
SCRIPT = Path(__file__).parents[1] / "decks" / "energy_checks.py"


@pytest.mark.skipif(not CLONE, reason="needs a clone of neuralclothsim: NEURALCLOTHSIM=PATH")
def test_the_energies_are_those_of_the_printed_strain_and_the_reversed_bottom():
    """Simpson's rule with a reversed bottom: a/12 (top^2 + 4 middle^2 - bottom^2), top = e + h k/2."""
    out = subprocess.run([sys.executable, str(SCRIPT), CLONE], capture_output=True, text=True, check=True).stdout
    rolled = [float(share) for share in re.findall(r"degrees: (\S+) of", out)]
    for found, degrees in zip(rolled, (10, 45, 90, 180), strict=True):
        # equation (30) for u = (sin(k x)/k - x, 0, (1 - cos(k x))/k): kappa_11 = -k (cos(k x) + sin(k x)^2)
        turned = [math.radians(degrees) * (n + 0.5) / 2000 for n in range(2000)]
        printed = sum((math.cos(t) + math.sin(t) ** 2) ** 2 for t in turned) / len(turned)
        assert found == pytest.approx(printed, abs=2e-4)
    modulus, thickness = 5.366, 3.7e-4
    lines = re.findall(r"stretch (\S+), curvature (\S+)/m: (\S+) J", out)
    assert len(lines) == 4
    for stretch, curvature, found in lines:
        e, bend = float(stretch), thickness * float(curvature) / 2
        density = modulus / 12 * ((e + bend) ** 2 + 4 * e**2 - (e - bend) ** 2)
        assert float(found) == pytest.approx(density, rel=0.02, abs=1e-12)


@pytest.mark.skipif(not CLONE, reason="needs a clone of neuralclothsim: NEURALCLOTHSIM=PATH")
def test_the_fabrics_have_no_bending_energy_and_two_thirds_of_the_stretch():
    """(top + 4 middle - bottom)/6 of an even energy is 4/6 of it flat, 0 folded both ways, -1/2 of bending at e = -h k/4."""
    script = SCRIPT.with_name("fabric_energies.py")
    out = subprocess.run([sys.executable, str(script), CLONE], capture_output=True, text=True, check=True).stdout
    assert [float(share) for share in re.findall(r"stretching (\S+)", out)] == pytest.approx([2 / 3] * 3, abs=1e-3)
    assert [float(share) for share in re.findall(r"released (\S+) %,", out)] == pytest.approx([0.0] * 6, abs=0.5)
    assert [float(share) for share in re.findall(r"strain: released (\S+) %", out)] == pytest.approx(
        [-50.0] * 3, abs=1.5
    )
    for law, fem in re.findall(r"stretch 0: bending (\S+) J/m\^2, fem (\S+);", out):
        assert float(fem) == pytest.approx(float(law), rel=0.02)
