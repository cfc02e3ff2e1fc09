"""A command as a solver: its files, its failures in one sentence, and its identity, which changes with the program."""

import re
import shutil
import subprocess
import sys
import textwrap
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import shellbench
from shellbench.bench.catalogue import catalog, templates
from shellbench.bench.plugins import registry
from shellbench.bench.run import local
from shellbench.bench.store.store import Store
from shellbench.errors import InputError, SolveFailure
from shellbench.protocol import program
from shellbench.testing.conforming import OF_FIELD, store_results
from shellbench.testing.suite import CheckOptions, examine
from tests.bench.running import InThisProcess, command
from tests.testing.test_suite import InProcess

PLATE = shellbench.case("square_plate").without(["strain_energy", "membrane_energy", "bending_energy"])
CENTRE = PLATE.primary.name
MADE = """
import json, math, os, sys, time
mesh, out, cells = sys.argv[1:]
FACTOR = 1.0
K = range(1, 10, 2)
SUM = sum((-1) ** ((m + n) // 2 - 1) / (m * n * (m * m + n * n) ** 2) for m in K for n in K)
def w(x, y):  # Navier's series of a plate under a uniform load, scaled to its known middle
    terms = (math.sin(m * math.pi * x / 100) * math.sin(n * math.pi * y / 100) / (m * n * (m * m + n * n) ** 2) for m in K for n in K)
    return -FACTOR * KNOWN * (1 + 0.01 / int(cells) ** 2) * sum(terms) / SUM
"""
READ = {
    "json": "found = json.load(open(mesh)); nodes = found['nodes']\nassert abs(sum(f[2] for f in found['forces']) * 4 + 1e4) < 1e-6, 'load'\n"
    "assert len(found['held']) == len(nodes) and max(map(max, found['cells'])) == len(nodes)",
    "tables": "nodes = [list(map(float, line.split(',')[1:])) for line in open(mesh + '/nodes.csv')]\n"
    "assert abs(sum(float(line.split(',')[2]) for line in open(mesh + '/forces.csv')) * 4 + 1e4) < 1e-6, 'load'",
    "vtu": "import meshio; found = meshio.read(mesh); nodes = found.points.tolist()\nassert 'held' in found.point_data",
}
WRITE = {
    "node": "open(out, 'w').write('node,ux,uy,uz\\n' + ''.join(f'{k},0,0,{w(x, y)!r}\\n' for k, (x, y, z) in enumerate(nodes, 1)))",
    "place": "open(out, 'w').write(''.join(f'{x!r} {y!r} {z!r} 0 0 {w(x, y)!r}\\n' for x, y, z in reversed(nodes)))",
    "dat": "open(out, 'w').write(' displacements (vx,vy,vz) for set ALL\\n\\n' + ''.join(f'{k} 0 0 {w(x, y)!r}\\n'"
    " for k, (x, y, z) in enumerate(nodes, 1)) + ' forces (fx,fy,fz)\\n 1 7 7 7\\n')",
    "vtu": "import meshio; meshio.Mesh(nodes, [('vertex', [[0]])], point_data={'U': [[0, 0, w(x, y)] for x, y, z in nodes]})"
    ".write(out, file_format='vtu')",
    "values": f"open(out, 'w').write(f'quantity,value\\n{CENTRE},{{-w(50, 50)}}\\nlargest_displacement,{{-w(50, 50)}}\\n')",
}


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Write the file of a solver and its script; no other test knows it."""
    monkeypatch.setattr(registry, "_OF_FILES", {})
    monkeypatch.setattr(program, "FRESH", 1e-9)

    def written(script: str, name: str = "mine", **fields: object) -> Path:
        known = catalog.known_values("square_plate").judge(CENTRE, PLATE.theory).value
        (tmp_path / f"{name}.py").write_text(MADE.replace("KNOWN", repr(known)) + textwrap.dedent(script))
        data = {
            "theory": "kirchhoff-love-linear",
            "command": f"'{sys.executable}' {name}.py {{mesh}} {{out}} {{cells}}",
            "version": f"'{sys.executable}' --version",
            "cells": [4, 8],
        } | fields
        path = tmp_path / f"{name}.toml"
        path.write_text("".join(f"{key} = {value!r}\n".replace("False", "false") for key, value in data.items()))
        return path

    return written


def solve(path: Path):
    solver = registry.load_solver(registry.find_solver(str(path)))
    return solver.solve(PLATE, solver.settings_type())


@pytest.mark.parametrize(
    ("mesh", "result", "read"),
    [
        ("json", "csv", "node"),
        ("tables", "dat", "dat"),
        ("vtu", "vtu", "vtu"),
        ("json", "csv", "place"),
        ("json", "values", "values"),
    ],
)
def test_an_exact_answer_is_read_in_every_format_and_the_ladder_tells_its_limit(write, mesh, result, read):
    answer = solve(
        write(
            f"{READ[mesh]}\n{WRITE[read]}",
            mesh=mesh,
            result=result,
            cells=[4, 8, 16],
            shape="tri3" if mesh == "vtu" else "quad9",
        )
    )
    known = catalog.known_values("square_plate").judge(CENTRE, PLATE.theory).value
    assert answer.history[-1].quantities[CENTRE] == pytest.approx(known * (1 + 0.01 / 16**2), rel=1e-9)
    assert answer.extrapolated[CENTRE] == pytest.approx(known, rel=1e-6)
    assert answer.uncertainty[CENTRE] == pytest.approx(known * 0.015 / 16**2, rel=0.01)


@pytest.mark.parametrize("result", ["csv", "values"])
def test_an_answer_is_no_surer_than_its_digits_and_the_rate_of_its_element(write, result):
    script, fields = READ["json"] + "\n" + WRITE["node" if result == "csv" else "values"], {"result": result}
    rounded = re.sub(r"(w\([^)]*\))(!r)?}", r"\1:.3f}", script)
    assert solve(write(rounded, **fields)).uncertainty[CENTRE] == pytest.approx(5e-4)
    steep = solve(write("FACTOR += 1 / int(cells) ** 8\n" + script, "steep", cells=[2, 4, 8], **fields))
    assert steep.uncertainty[CENTRE] >= abs(np.diff([step.quantities[CENTRE] for step in steep.history])[-1]) / 3


GOOD = f"{READ['json']}\n"
FAILURES = {
    "ends with": (GOOD + "print('*ERROR: no key\\nstop'); sys.exit(3)", r"status 3 on 4 x 4 cells: \*ERROR: no key$"),
    "dies": (GOOD + "os.abort()", "was ended by signal 6 on 4 x 4 cells"),
    "raises": (GOOD + "1 / 0", "exit status 1 on 4 x 4 cells: ZeroDivisionError: division by zero"),
    "hangs": (GOOD + "os.system(f'sleep 60.51 & sleep 60')", "did not end within 0.5 s on 4 x 4 cells"),
    "leaves nothing": (GOOD + "print('done\\n' + '_' * 40)", "leaves no result on 4 x 4 cells: done$"),
    "stops early": (
        GOOD + "nodes.pop(); print('stopped')\n" + WRITE["node"],
        "24 of 25 nodes; node 25 has no displacement: stopped",
    ),
    "writes no number": (
        GOOD + WRITE["node"] + "\nopen(out, 'a').write('1, 0, 0, ****')",
        "line 27 of its result: found '\\*\\*\\*\\*', which is no number",
    ),
    "diverges": (GOOD + "FACTOR = math.nan\n" + WRITE["node"], "a displacement that is not finite, at node 1"),
    "repeats a node": (GOOD + "nodes.append(nodes[3])\n" + WRITE["place"], "node 4 has 2 displacements"),
    "has another mesh": (GOOD + "nodes[0][0] += 1e-3\n" + WRITE["place"], "a place .* at which the mesh has no node"),
    "forgets a value": (GOOD + f"open(out, 'w').write('{CENTRE}, 1.0')", "no finite value of largest_displacement"),
}


@pytest.mark.parametrize("how", FAILURES)
def test_a_program_that_fails_costs_one_sentence_with_its_last_line(write, how):
    script, said = FAILURES[how]
    with pytest.raises(SolveFailure, match=said):
        solve(write(script, seconds=0.5 if how == "hangs" else 60.0, result="values" if "value" in how else "csv"))
    assert not subprocess.run(["pgrep", "-f", "sleep 60.51"], capture_output=True, check=False).stdout


def test_a_failure_on_a_finer_mesh_keeps_the_answer_before(write):
    with pytest.raises(SolveFailure, match="on 8 x 8 cells: no memory") as failed:
        solve(write(GOOD + "if cells == '8': sys.exit('no memory')\n" + WRITE["node"]))
    assert CENTRE in failed.value.partial.case.quantities[0].name
    assert failed.value.partial.displacement([[50.0, 50.0]])[0, 2] < 0


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"command": "no-such-program {mesh}"}, "field 'command': there is no program 'no-such-program'"),
        (
            {"command": f"'{sys.executable}' mine.py {{msh}}"},
            "{msh} is not known here: known are {case}, {mesh}, {out}",
        ),
        ({"command": f"'{sys.executable}"}, "field 'command': no closing quotation"),
        ({"version": "true"}, "field 'version': 'true' prints nothing"),
        ({"files": ["*.jl"]}, "field 'files': there is no file '*.jl' in its folder"),
        ({"name": "fem"}, "field 'name': 'fem' is that of an installed solver already"),
        (
            {"theory": "thick"},
            "field 'theory': found 'thick', but it must be 'kirchhoff-love-linear' or 'naghdi-linear'",
        ),
        ({"resul": "csv"}, "field 'resul' is not known here (did you mean result?)"),
        ({"mesh": "inp", "shape": "quad9"}, "field 'shape': cells of meshes .inp are quad4, quad8, tri3, tri6"),
        ({"cells": []}, "field 'cells': found [], but it must be of at least 1 entry"),
    ],
)
def test_a_file_that_describes_no_command_is_bad_input(write, monkeypatch, capfd, fields, said):
    code, _, err = command(monkeypatch, capfd, "run", "square_plate", "--solver", write("", **fields))
    assert (code, err.count("\n")) == (2, 1)
    assert said in err


class Here(InThisProcess):
    def __init__(self, *asked): ...


def test_a_changed_program_is_never_answered_by_an_old_record_and_no_gate_passes_it(
    write, tmp_path, monkeypatch, capfd
):
    monkeypatch.setattr(local, "LocalProcesses", Here)
    monkeypatch.chdir(tmp_path)
    tell = partial(command, monkeypatch, capfd)
    data, about = tmp_path / "data.txt", tmp_path / "about.txt"
    data.write_text("1")
    about.write_text("1.0")
    fields = {"files": ["data.*"], "version": "sh -c 'cat {here}/about.txt'", "symmetry": False}
    path = write(GOOD.replace(" * 4 +", " +") + WRITE["node"], **fields)
    changes = (
        lambda: (tmp_path / "mine.py").write_text(
            (tmp_path / "mine.py").read_text().replace("FACTOR = 1.0", "FACTOR = 1.1")
        ),
        lambda: data.write_text("2"),
        lambda: about.write_text("1.1"),
        lambda: path.write_text(path.read_text() + "seconds = 50"),
    )
    assert tell("run", "square_plate", "--solver", path)[1].endswith("1 solved\n")
    for change in changes:
        assert tell("run", "square_plate", "--solver", path)[:2] == (0, "1 kept from before\n")
        change()
        assert tell("run", "square_plate", "--solver", path)[1].endswith("1 solved\n")
    path.write_text(path.read_text() + "0")
    assert tell("gate", "--solver", path)[0] == 2
    assert "the solver has changed since" in tell("table", "--solver", path)[2]
    path.write_text(path.read_text()[:-1])
    code, out, _ = tell("gate", "square_plate", "--solver", path)  # a tenth too large since the first change
    assert (code, "RED  square_plate mine centre_deflection, largest_displacement: its error is 0.1," in out) == (
        1,
        True,
    )
    code, out, _ = tell("table", "--solver", path)
    assert (code, len(re.findall(r"^  mine .* \+10 %", out, re.MULTILINE))) == (0, 1)
    right = write(GOOD + WRITE["node"], name="right", cells=[32])
    assert tell("run", "square_plate", "--solver", right)[1].endswith("1 solved\n")
    code, out, _ = tell("gate", "--solver", right)
    assert (
        code,
        "right is not checked and holds no class, though its 2 figures of 1 case are within 0.0001" in out,
    ) == (1, True)
    assert (tell("compare", right, path)[0], tell("compare", path, right)[0]) == (1, 0)
    registry._OF_FILES.clear()  # as in a new process that does not name the files
    assert tell("gate")[0] == 2
    data.unlink()
    assert "there is no file 'data.*'" in tell("gate", "--solver", path)[2]


ANYWHERE = """
import numpy as np; found = json.load(open(mesh))
nodes, n = np.array(found['nodes']), np.array(found['normals'])
a, b, _, d = nodes[np.array(found['cells'][0]) - 1]
x, y = ((nodes - a) @ (side - a) / np.linalg.norm(side - a) for side in (b, d))
q = np.sum(np.array(found['forces'])[:, :3] * n) / 1e4
u = n * np.array([[-q * w(*at)] for at in zip(x, y)])
"""
FAULTS = {
    "": "holds class 0.0001 on displacements in all 2 figures of 1 case",
    "u *= 1.05": "is not checked and holds no class: its check 'work' failed: .* \\(`shellbench check-solver mine.toml`",
    "u *= np.abs(u).max(axis=1, keepdims=True) / np.abs(u).max()": "though its 2 figures .* are within 0.0001: its check 'work' failed",
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_class_on_displacements_needs_a_right_field(write, fault, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(local, "LocalProcesses", Here)
    monkeypatch.chdir(tmp_path)
    path = write(f"{ANYWHERE}\n{fault}\nnp.savetxt(out, np.c_[1:len(u) + 1, u])", cells=[16], symmetry=False)
    assert command(monkeypatch, capfd, "run", "square_plate", "--solver", path)[0] == 0
    entry = registry.find_solver(str(path))
    options = CheckOptions((shellbench.case("square_plate"),), checks=("energies", "work") if fault else OF_FIELD)
    lines = list(examine(entry, options, start=lambda: InProcess(entry)))
    assert [line.check for line in lines if line.verdict.status == "not applicable"] == ["energies"]
    store_results(Store(Path("reports/runs")), entry, lines)
    code, out, _ = command(monkeypatch, capfd, "gate", "--solver", path)
    assert (code, bool(re.search(FAULTS[fault], out))) == (bool(fault), True), out
    assert command(monkeypatch, capfd, "pack", path)[0] == 0
    assert command(monkeypatch, capfd, "list", path)[1].startswith("mine: the command")
    assert "describes a solver, not a case" in command(monkeypatch, capfd, "run", path)[2]


@pytest.mark.long
def test_check_solver_asks_a_command_in_a_process_of_its_own(write, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", "of-the-caller")
    path = write("assert os.environ['PYTHONPATH'] == 'of-the-caller'\n" + GOOD + WRITE["node"], cells=[4])
    code, out, _ = command(monkeypatch, capfd, "check-solver", path, "--checks-only", "--case", "clamped_plate_uniform")
    assert "passed         protocol: kirchhoff-love-linear" in out
    assert "passed         answers (clamped_plate_uniform): points of 4 shapes" in out
    assert code == 1  # its field is that of another plate


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
def test_the_example_solves_the_roof_by_calculix(tmp_path, monkeypatch):
    monkeypatch.setattr(registry, "_OF_FILES", {})
    path = templates.write_command("my_ccx", tmp_path)
    solver = registry.load_solver(registry.find_solver(str(path)))
    roof = shellbench.case("scordelis_lo@naghdi_soft")
    roof = roof.without([q.name for q in roof.quantities if not q.primary])
    answer = solver.solve(roof, solver.settings_type(cells=(8, 16)))
    limit = catalog.known_values(roof.name).judge(roof.primary.name, roof.theory).value
    assert roof.primary.measure(answer) == pytest.approx(limit, rel=1e-3)
    (tmp_path / "deck.toml").write_text(re.sub('"tables"', '"inp"', path.read_text().replace("my-ccx", "deck")))
    (tmp_path / "solve.sh").write_text('ccx -i "${1%.inp}" && cp "${1%.inp}.dat" "$2"')
    other = registry.load_solver(registry.find_solver(str(tmp_path / "deck.toml")))
    same = other.solve(roof, other.settings_type(cells=(8, 16)))
    assert roof.primary.measure(same) == pytest.approx(roof.primary.measure(answer), rel=1e-5)
    registry._OF_FILES.clear()
    with pytest.raises(InputError, match="is there already"):
        templates.write_command("my-ccx", tmp_path)
