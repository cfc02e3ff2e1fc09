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
