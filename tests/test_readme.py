"""Each figure of the README and of the findings against the committed file that it is said to come from.

Whole tables are those that the records of the example print. Every other figure stands in a sentence or a row with
braces in its place, which are filled from a file. What is left are numbers that no run has found: `DEFINED` has them.
`python -m tests.test_readme` writes the whole tables anew; a failing sentence says what it should read.
"""

import csv
import json
import re
import tomllib
from functools import cache
from pathlib import Path

import pytest
from scipy.stats import beta

from docs.course_page import cheapest_run
from shellbench.bench.judge.classes import LOOSEST
from shellbench.bench.judge.row import Row
from shellbench.problem import VARIANT
from shellbench.report.data.kept_data import read_summary
from shellbench.report.data.notation import FINEST, byte_size, duration, percent, quoted, rounded
from shellbench.report.sections import tables

ROOT = Path(__file__).parents[1]
FINDINGS = ROOT / "docs/findings"
INDEX = FINDINGS / "index.md"
NUMBER = re.compile(r"(?<![A-Za-z])\d[\d.e-]*(?<![.-])")
PAGES = (
    ROOT / "README.md",
    ROOT / "docs/index.md",
    ROOT / "docs/using.md",
    ROOT / "docs/verdict.md",
    *sorted(FINDINGS.glob("*.md")),
)
TABLES = {"obstacle_course": FINDINGS / "course.md"}  # pages that show the whole table of a suite
LINEAR = ("square_plate", "scordelis_lo", "pinched_cylinder_diaphragm", "pinched_cylinder_free")
MADE = re.compile(r"<!-- table \w+ -->.*?<!-- end -->", re.DOTALL)  # tests/test_course_page.py holds them
FENCED = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)

DEFINED = (  # no figures of a run: what things are called, what was asked for, what others have published
    r"at most 2 for 95 % of the values, and never more than 5|a ratio above 5|and 1e-12 of the value",
    r"\b1e-2, 1e-3 and 1e-4|[Aa]n error above 1e-2|within three uncertainties",
    r"\b(3 to 7|6 to 13) minutes|\b(1\.4|2\.4) GB",  # measured by hand, and said roughly
    r"Python 3\.11( to 3\.13)?|x86-64",
    r"its default, 1e-4, is the tightest",
    r"\(20\d\d\)|\b2024 version",
    r"[Ee]quation \(30\)|equations \(33\) to \(35\)|Table [13]\b",
    r"exits? [012]\b|\b(0 is good|1 is a failed|2 is bad|130 is an interrupted)",
    r"\bP = 4\b",
    r"by (90|180) degrees|at 90 degrees",
    r"displacement of 12 ",
    r"h\^2/12",
    r"\bT/2\b|T = 1 s",
    r"256 material points",
    r"\b(5 x 5|10 x 10|15 x 15) (random|fixed)|with 10 x 10",
    r"float16|float32|[Ff]loat64|\b16 bits",
    r"(error of|reaches|At) 0\.01 %|0\.1 % \| 0\.01 % \| 0\.001 %",
    r"h/L = (5e-5|1e-[234])",
    r"8 x 8, 1/240 s",
    r"20 x 20; 40 x 40; 80 x 80|mesh, 128 x 128|off on 20 x 20",
    r"at 0\.5 s",
    r"degree 3 and 4|degree 5 to 7|degree 5 \(3, those of",
    r"weight 1e10",
    r"5 x 512|20 x 20 random samples|in motion 20 x 20 x 20",
    r"an error (below|of) 1 % ?(for the worst)?",
    r"about 0\.35 s",
    r"38 s on two quiet cores, 59 s of processor time",  # of `shellbench quick`, measured by hand
    r"More than 1e-3 of a linear value, or 2e-2 of one on a path",
)  # fmt: skip


@cache
def rows(folder, name):
    """Rows of a CSV file of an example."""
    with (ROOT / "reports" / folder / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@cache
def objects(folder):
    """Rows of the JSON table of an example."""
    found = json.loads((ROOT / "reports" / folder / "table.json").read_bytes())
    for row in found:  # a row has both in one name
        row["case"] += f"{VARIANT}{variant}" if (variant := row.pop("variant", None)) else ""
    return [Row.model_validate(row) for row in found]


def one(found):
    (only,) = found
    return only


def row(name, folder="example", **keys):
    """The row of a CSV file with these cells."""
    return one(r for r in rows(folder, name) if all(r[k] == v for k, v in keys.items()))


def answer(case, solver, quantity, label="", folder="example"):
    """The only run of a case, by the name of its settings, as far as one quantity goes."""
    found = [r for r in objects(folder) if (r.case, r.solver, r.quantity) == (case, solver, quantity)]
    return one(r for r in found if (r.label or "") == label)


@cache
def known(case):
    with (ROOT / "references" / f"{case}.toml").open("rb") as file:
        return tomllib.load(file)["values"]


def judge(case, quantity):
    return one(v["value"] for v in known(case) if (v["quantity"], v["role"]) == (quantity, "judge"))


def kept(case):
    """The record of the published training of a case."""
    return json.loads(one((ROOT / "reports/published").glob(f"{case}-*.json")).read_bytes())


def described(case, pattern):
    """Return the groups of a pattern in the description of a case."""
    with (ROOT / "cases" / f"{case}.toml").open("rb") as file:
        return re.search(pattern, tomllib.load(file)["description"]).groups()


def text_of(digits):
    return digits.mantissa + (f"e{digits.exponent}" if digits.exponent else "")


def error(relative):
    """A relative error, as tables print it."""
    return f"{text_of(percent(float(relative)))} %"


def told(relative, unknown):
    """A relative error, or that it is smaller than what is known."""
    return error(relative) if abs(relative) > unknown else f"below {size(unknown).replace('.0e', 'e')}"


def size(relative):
    """A relative error without its sign."""
    return f"{text_of(percent(abs(float(relative)), signed=False))} %"


def figures(value, count):
    """A number with so many significant digits."""
    value = float(value)
    if value and not 1e-3 <= abs(value) < 1e5:
        mantissa, _, power = f"{value:.{count - 1}e}".partition("e")
        return f"{mantissa}e{int(power)}"
    return f"{value:#.{count}g}".rstrip(".")


COURSE = {  # what the table of the README calls its solvers
    "fem": "`fem`, C1 finite elements",
    "ndf-ritz": "`ndf-ritz`, neural field, output layer solved",
    "ndf": "`ndf`, neural field, trained",
}
SHELLS = (*LINEAR, "sleeve_course", "napkin_course")


def mean_error(case, solver):
    """Relative error of the headline, mean over the seeds of the obstacle course."""
    found = [r for r in objects("course") if (r.case, r.solver) == (case, solver) and r.primary]
    errors = [r.relative_error for r in found if "obstacle_course" in r.suites and r.default_settings]
    assert len(errors) == (3 if solver != "fem" and case in LINEAR else 1)
    return sum(errors) / len(errors)


def the_course():
    """Return the table of the README: a line a solver, a column a shell."""
    line = f"| {{}} |{' {} |' * len(SHELLS)}"
    named = {case: next(r.quantity for r in objects("course") if r.case == case and r.primary) for case in SHELLS}
    judges = {
        case: one(v for v in known(case) if (v["quantity"], v["role"]) == (name, "judge"))
        for case, name in named.items()
    }
    units = ["rad" if case == "sleeve_course" else "m" for case in SHELLS]
    known_to = [(v["value"], v["uncertainty"]) for v in judges.values()]  # some better than other tables print
    values = [str(x) if doubt < FINEST * x else text_of(rounded(x, doubt)) for x, doubt in known_to]
    yield f"{line} - |", "known value", *(f"{value} {unit}" for value, unit in zip(values, units, strict=True))
    for solver, title in COURSE.items():
        judged = [r for r in objects("course") if r.solver == solver and "obstacle_course" in r.suites]
        assert judged
        assert all(r.passed or r.open_finding for r in judged if r.tolerance is not None)
        errors = [told(mean_error(case, solver), v["uncertainty"] / v["value"]) for case, v in judges.items()]
        yield f"{line} pass |", title, *errors
    hinges = {r["case"]: r for r in json.loads((ROOT / "reports/hinges.json").read_bytes())}
    assert all(abs(r["relative_error"]) > LOOSEST for r in hinges.values())
    yield f"{line} fail |", "`cst-hinge`, cloth mesh", *(error(hinges[c]["relative_error"]) for c in LINEAR), "-", "-"
    trained = [kept(case)["values"][named[case]]["value"] / judges[case]["value"] - 1 for case in LINEAR[:3]]
    assert kept(LINEAR[3])["status"] == "failed"
    yield f"{line} fail |", "`ndf-published`, NeuralClothSim as printed", *map(error, trained), "failed", "-", "-"
    for label, title in (("Analytical", "usually quoted"), ("NeuralClothSim", "NeuralClothSim, preprint, Table 3")):
        said = [
            one(v["value"] for v in known(c) if (v["quantity"], v.get("label")) == (named[c], label)) for c in LINEAR
        ]
        errors = [error(v / judges[case]["value"] - 1) for case, v in zip(LINEAR, said, strict=True)]
        yield f"{line} - |", title, *errors, "-", "-"


def what_fell_short():
    gated = sum(r.passed is True for r in objects("example"))
    assert not any(r.passed is False for r in objects("example"))
    open_findings = sum(r.open_finding is not None for r in objects("example"))
    runs = {(r.case, r.label, r.reason) for r in objects("example") if r.status != "ok" and set(r.suites) & COMPARED}
    labels = [label for _, label, _ in runs]
    pin = {name: answer("napkin_soft_pin", "ndf", f"{name}_energy_{at}").relative_error
           for name, at in (("bending", "400ms"), ("membrane", "600ms"))}  # fmt: skip
    yield "All {} gated values pass, and {} more are open findings", gated, open_findings
    yield "Its bending energy is then {} off, its membrane energy {}.", size(pin["bending"]), size(pin["membrane"])
    yield (
        "none of the {} runs that failed: ReLU on {} shells, soft supports of weight 1e10 on {}, a cosine alone on {},",
        len(runs), *(str(labels.count(label)) for label in ("ReLU", "soft supports, weight 1e10", "cosine only")),
    )  # fmt: skip


COMPARED = {"ablations", "strain_ablation", "obstacle_course", "nonlinear", "cloth"}


def quoted_figures():
    values = [one(v["value"] for v in known(case) if v["role"] == "literature") for case in LINEAR[1:]]
    said = [text_of(quoted(value)) for value in values]
    yield ("roof's {} mixes theories, the diaphragm cylinder's {} is a truncated series, the free cylinder's {}", *said)


CIRCULATING = {
    "scordelis_lo": "Scordelis-Lo roof",
    "pinched_cylinder_diaphragm": "Pinched cylinder, diaphragms",
    "pinched_cylinder_free": "Pinched cylinder, free ends",
    "hemisphere_hole": "Hemisphere with a hole",
    **{f"hypar_clamped_1e_{power}": f"Hypar clamped on a side, h/L = 1e-{power}" for power in (2, 3, 4)},
}


def circulating_figures():
    for case, title in CIRCULATING.items():
        for said in (v for v in known(case) if v["role"] == "literature"):
            value = one(v for v in known(case) if (v["quantity"], v["role"]) == (said["quantity"], "judge"))
            yield (
                f"| {title}, m | {{}} | {{}} | {{}} |", text_of(quoted(said["value"])),
                text_of(rounded(value["value"], value["uncertainty"])), error(said["value"] / value["value"] - 1),
            )  # fmt: skip


def collapse():
    page = (ROOT / "reports/replication/README.md").read_text(encoding="utf-8")
    cells = {
        line.split("|")[1].strip().partition(",")[0]: [cell.strip() for cell in line.split("|")[2:-1]]
        for line in page.splitlines()
        if re.match(r"\| (56[0-2]|926|957)\b", line)
    }
    (_, before, short), (_, after, long) = cells["560"], cells["561"]
    yield (
        "until iteration {}. The largest energy of one sample then jumps from {} to {},"
        " and the length of the gradient from {} to {}.",
        561, before, after, short, long,
    )  # fmt: skip
    yield "from {} in iteration {} to {} in iteration {}", cells["926"][0], 926, cells["957"][0], 957


TRAINED = ("Square plate", "Scordelis-Lo roof", "Pinched cylinder, diaphragms", "Pinched cylinder, free")
PUBLISHED_WIDTH, PUBLISHED_LENGTH = 512, 2500


@cache
def trainings():
    """Kept records of trainings of the course by case, recipe and seed."""
    found = {}
    for path in (path for name in ("published", "replication") for path in (ROOT / "reports" / name).glob("*.json")):
        record = json.loads(path.read_bytes())
        settings = record["identity"]["settings"]
        recipe = (
            "as printed" if settings["width"] == PUBLISHED_WIDTH
            else f"repaired, {settings['dtype']}" if settings["dtype"] != "float32"
            else "repaired" if settings["iterations"] <= PUBLISHED_LENGTH
            else "repaired, longer"
        )  # fmt: skip
        key = record["case_name"], recipe, record["identity"]["seed"]
        assert key not in found
        found[key] = record
    return found


def trained_errors(record):
    """Relative error of the headline of a training, and how far its certified energy is above the least."""
    case, (primary, *_) = record["case_name"], record["values"]
    least = judge(case, "strain_energy")  # the least potential energy is minus that
    return (
        record["values"][primary]["value"] / judge(case, primary) - 1,
        1 + record["diagnostics"]["certified_energy"] / least,
    )


def seeds_of_training():
    """Displacement and energy above the least of each seed, by recipe."""
    for recipe in ("as printed", "repaired", "repaired, longer"):
        for case, title in zip(LINEAR, TRAINED, strict=True):
            found = [trainings().get((case, recipe, seed)) for seed in range(3)]
            if any(found):
                yield f"| {title} | {recipe} | {{}} | {{}} | {{}} |", *map(seed_cell, found)


def seed_cell(record):
    if record is None or record["status"] != "ok":
        return "not run" if record is None else "failed"
    off, above = trained_errors(record)
    return f"{error(off)}; {size(above)}"


FURTHER = {"pinched_cylinder_diaphragm": ", singular features", "pinched_cylinder_free": ", singular features, no pins"}


def natural_gradient():
    """Displacement and energy above the least of trainings by natural gradient, and their processor time."""
    for case, title in zip(LINEAR, TRAINED, strict=True):
        found = [row("natural", "studies", case=case, seed=str(seed)) for seed in range(3)]
        cells = [f"{error(r['error'])}; {size(r['above'])}" for r in found]
        settings, longest = json.loads(found[0]["settings"]), max(float(r["seconds"]) for r in found)
        line = f"| {title} | {{}}{FURTHER.get(case, '')} | {{}} | {{}} | {{}} | {{}} s |"
        yield line, settings["iterations"], *cells, duration(longest)
    everyone = [[r for r in rows("studies", "natural") if r["case"] == case] for case in LINEAR]
    assert all(r["status"] == "ok" for of_case in everyone for r in of_case)
    worst = [max(abs(float(r["error"])) for r in of_case) for of_case in everyone]
    assert max(worst[:2]) < 0.01 < min(worst[2:])
    yield "With its worst seed the diaphragm cylinder errs by {}, the free one by {}.", *map(size, worst[2:])
    yield "No training took more than {} s of a core", duration(max(float(r["seconds"]) for c in everyone for r in c))
    yield (
        "displacement, worst seed: plate {}, roof {}, diaphragm cylinder {}, free cylinder {}",
        *(error(max((float(r["error"]) for r in of_case), key=abs)) for of_case in everyone),
    )
    short = trained_errors(trainings()["pinched_cylinder_free", "repaired", 0])[0]
    yield "The free cylinder is {} short by Adam", size(short)
    yield "{} neurons a layer, {} x {} cells of samples", settings["width"], *settings["cells"]


def published_training():
    """The summary of the trainings: errors of displacement of the first seed, and of all seeds."""
    found = trainings()
    first, repaired = (
        [found.get((case, f"{recipe}, longer", 0)) or found[case, recipe, 0] for case in LINEAR]
        for recipe in ("as printed", "repaired")
    )
    assert [record["status"] for record in first] == ["ok", "ok", "ok", "failed"]
    yield (
        "displacement: plate {}, roof {}, diaphragm cylinder {}, free cylinder failed",
        *(error(trained_errors(record)[0]) for record in first[:3]),
    )
    yield (
        "displacement: plate {}, roof {}, diaphragm cylinder {}, free cylinder {}",
        *(error(trained_errors(record)[0]) for record in repaired),
    )
    far = [abs(trained_errors(found[case, "as printed", seed])[0]) for case in LINEAR[1:3] for seed in range(3)]
    yield "It errs by {} to {} on the roof and the diaphragm cylinder", size(min(far)), size(max(far))
    seconds = [record["seconds"] for record in first]
    yield "A training takes {} to {} s on a CPU", duration(min(seconds)), duration(max(seconds))
    record = kept(LINEAR[3])
    course = {step["iteration"]: step["quantities"]["load_deflection"] for step in record["history"]}
    good = max(step["iteration"] for step in record["history"] if step["energy"] < 0)
    assert record["diagnostics"]["certified_energy"] > 0
    end = figures(record["values"]["load_deflection"]["value"], 2)
    yield "The deflection is {} m at iteration {} and {} m at the end", figures(course[good], 2), good, end


def strain_measures():
    def cells(case, quantity, *columns):
        found = row("strains", case=case, quantity=quantity)
        return [error(found[f"{column}_error"]) for column in columns], float(found["exact"]), found

    both = ("published", "linear")
    said, exact, _ = cells("rolled_plate", "bending_energy_90", *both)
    yield "| rolled plate, bending energy at 90 degrees | {} J | {} | {} |", figures(exact, 5), *said
    yield "right for small rotations; {} of bending energy on a plate rolled by 90 degrees", said[0]
    turned = row("strains", case="rigid_rotation", quantity="strain_energy_180")
    yield (
        "by 180 degrees, strain energy | {} J | {} J | {} J |",
        figures(turned["exact"], 1), figures(turned["published"], 2), figures(turned["linear"], 2),
    )  # fmt: skip
    said, exact, _ = cells("cantilever_shear", "deflection_4", *both)
    yield "| cantilever under end shear, deflection at P = 4 | {} m | {} | {} |", figures(exact, 6), *said
    said, exact, found = cells("cantilever_moment", "shortening_100", "linear")
    assert found["published_status"] == "failed"
    reason = answer("cantilever_moment", "ndf-ritz", "shortening_100", "published").reason
    last = re.search(r"at load factor ([\d.]+)", reason)[1]
    yield (
        "displacement of the tip | {} m | no equilibrium beyond {} of the moment | {} |",
        figures(exact, 6), figures(last, 2), *said,
    )  # fmt: skip
    yield "The roll-up does not end at a displacement of 12 but of {}**", figures(found["reference"], 6)
    for case, quantity, name in (
        ("square_plate_nonlinear", "centre_deflection", "square plate"),
        ("scordelis_lo_nonlinear", "edge_deflection", "Scordelis-Lo roof"),
    ):
        said, exact, _ = cells(case, quantity, *both)
        yield f"| {name} at full strain, deflection | {{}} m | {{}} | {{}} |", figures(exact, 6), *said
    headlines = [(r.case, r.quantity) for r in objects("example") if r.primary and "nonlinear" in r.suites]
    quoted_by_sze = [
        abs(v["value"] / judge(case, quantity) - 1)
        for case, quantity in dict.fromkeys(headlines)
        for v in known(case)
        if (v["quantity"], v["role"], v["source"]) == (quantity, "literature", "sze2004")
    ]
    yield (
        "benchmarks quote, differ from the known ones by {} to {}.",
        size(min(quoted_by_sze)),
        size(max(quoted_by_sze)),
    )
    yield (
        "back from a load factor of {} to {}",
        *described("cylinder_pull_out", r"factor of ([\d.]+) and forth at ([\d.]+\d)"),
    )


def motions():
    half, end = (row("newton", case="free_fall", quantity="fall", at=at) for at in ("0.5", "1.0"))
    newton, stationary, trained = (float(half[k]) for k in ("newton", "stationary", "ndf-published"))
    yield (
        "| fallen at T/2 | {} m | {} m ({} times) | {} m ({} times) |",
        figures(newton, 4), figures(stationary, 4), figures(stationary / newton, 3),
        figures(trained, 4), figures(trained / newton, 3),
    )  # fmt: skip
    yield "at half time a body in free fall has fallen {} times the right distance", figures(stationary / newton, 3)
    newton, stationary, trained = (float(end[k]) for k in ("newton", "stationary", "ndf-published"))
    yield (
        "| fallen at T | {} m | {} m, and at rest | {} m ({} times) |",
        figures(newton, 4), figures(stationary, 4), figures(trained, 4), figures(trained / newton, 2),
    )  # fmt: skip
    yield "Beyond {} s no two meshes agree", *described("napkin_corner", r"beyond ([\d.]+) s no two meshes agree")
    fem, ndf = (answer("sleeve_compression", solver, "critical_force") for solver in ("fem", "ndf"))
    carried = [answer("sleeve_compression", solver, "force_after_buckling").value for solver in ("fem", "ndf")]
    yield (
        "`fem` finds the critical force of {} N to {}, `ndf` to {}. Just beyond it `fem` carries {} N and `ndf` {} N",
        figures(judge("sleeve_compression", "critical_force"), 4), size(fem.relative_error), size(ndf.relative_error),
        *(figures(force, 3) for force in carried),
    )  # fmt: skip


STUDIED = {
    "square_plate": "Square plate",
    "scordelis_lo": "Scordelis-Lo roof",
    "pinched_cylinder_diaphragm": "Pinched cylinder, diaphragms",
    "pinched_cylinder_free": "Pinched cylinder, free",
}


def costs():
    """Bytes of `fem` and `ndf-ritz` within 0.01 %, from the table of docs/findings/course.md."""
    kept_runs = read_summary()

    def cheapest(case, solver):
        return cheapest_run(kept_runs, case, solver, 1e-4)

    solvers = {run.solver for run in kept_runs.runs}
    for case in SHELLS:
        fem = cheapest(case, "fem")
        others = [found for solver in solvers - {"fem"} if (found := cheapest(case, solver))]
        assert (fem is None and not others) if case == "sleeve_course" else all(fem.seconds < o.seconds for o in others)
        assert cheapest(case, "cst-hinge") is None
    ratio = {
        case: cheapest(case, "fem").storage / cheapest(case, "ndf-ritz").storage
        for case in SHELLS
        if case != "sleeve_course"
    }
    fewer = sorted(ratio[case] for case in ("square_plate", "pinched_cylinder_diaphragm", "napkin_course"))
    more = [1 / ratio[case] for case in ("scordelis_lo", "pinched_cylinder_free")]
    (most,) = {figures(share, 2) for share in more}
    least_and_most = figures(fewer[0], 2), figures(fewer[-1], 2)
    yield (
        "On the square plate, the diaphragm cylinder and the napkin, `ndf-ritz` takes {} to {} times fewer bytes than `fem`.",
        *least_and_most,
    )
    yield "On the roof and the free cylinder, `ndf-ritz` takes {} times more.", most
    yield (
        "takes {} to {} times fewer bytes than `fem` on three shells, and {} times more on two.",
        *least_and_most,
        most,
    )


def findings():
    plate = {
        solver: row("consistency", case="square_plate", solver=solver)
        for solver in ("fem", "ndf", "ndf-ritz", "cst-hinge")
    }

    def share(solver, column):
        return float(plate[solver][column]) / float(plate[solver]["largest_displacement"])

    steps = [size(share("cst-hinge", f"{column}_largest")) for column in ("step", "yardstick", "alike")]
    yield (
        "changes by {} from its last mesh but one, and is {} off the finest run of `fem`. Other diagonals on the same mesh change it by {}.",
        *steps,
    )
    fields = [
        max(share(solver, f"{what}_largest") for solver in ("ndf", "ndf-ritz")) for what in ("alike", "yardstick")
    ]
    yield (
        "`fem` changes by {} between slightly different meshes. Fields change by at most {} between seeds, and agree with `fem` to {}.",
        size(share("fem", "alike_largest")), *map(size, fields),
    )  # fmt: skip
    halved = [
        row("memory_rounding", case="square_plate", format="float16", solver=solver)["change"]
        for solver in ("fem", "ndf-ritz")
    ]
    yield "the plate's deflection changes by {} with `fem`, and by {} with `ndf-ritz`.", *map(size, halved)
    thin = {
        solver: row("thinness_pinched_cylinder_rigid_diaphragms", case="cylinder_thinness_5e_5", solver=solver)
        for solver in ("fem", "ndf", "ndf-ritz", "cst-hinge")
    }
    assert (thin["ndf"]["good"], thin["ndf-ritz"]["good"]) == ("1", "0")
    yield (
        "the trained field is {} too stiff, but these energies differ by {} only. `ndf-ritz` errs by {} and its runs"
        " fail. `cst-hinge` locks and errs by {}. `fem` errs by {} and states {}.",
        size(thin["ndf"]["mean_error"]), size(thin["ndf"]["gap"]), *(error(thin[solver]["mean_error"])
        for solver in ("ndf-ritz", "cst-hinge", "fem")), size(thin["fem"]["own_estimate"]),
    )  # fmt: skip
    few = [row("sampling", case="square_plate", solver="ndf-published", points=points) for points in ("25", "100")]
    errors = [size(found[f"{which}_error"]) for found in few for which in ("least", "largest")]
    yield "errs by {} to {} on the plate, with 10 x 10 by {} to {}.", *errors
    reasons = {r.reason for r in objects("example") if r.label == "ReLU" and r.status == "failed"}
    folded = sorted(float(re.search(r"([\d.]+) % of its changes", reason)[1]) for reason in reasons)
    yield "Of the rotation of its fields, {} to {} % is in kinks", f"{folded[0]:g}", f"{folded[-1]:g}"


def engines():
    own, apart = [], []
    by_default = {
        case: one(r for r in objects("example_engines") if (r.case, r.solver) == (case, "kratos-iga") and r.primary and r.default_settings)
        for case in LINEAR[2:]
    }  # fmt: skip
    yield (
        "At default settings it is {} off on the diaphragm cylinder and {} on the free one",
        *(error(r.relative_error) for r in by_default.values()),
    )
    for case in LINEAR:
        found = [r for r in rows("example_engines", "cross_check") if r["case"] == case]
        levels = ("0.001", "0.0001", "1e-05")
        fem = one(r for r in found if r["solver"] == "fem" and r["settings"])
        kratos = [
            [float(r[f"seconds_{k}"]) for r in found if r["solver"] == "kratos-iga" and r[f"seconds_{k}"]]
            for k in levels
        ]
        quantity = next(r.quantity for r in objects("example_engines") if r.case == case and r.primary)
        engine = one(v["value"] for v in known(case) if (v["quantity"], v["source"]) == (quantity, "kratos"))
        yield (
            f"| {STUDIED[case]} | {{}} | {{}} | {{}} | {{}}; {{}}; {{}} | {{}} |",
            *(duration(float(fem[f"seconds_{k}"])) for k in levels), *(duration(min(s)) for s in kratos),
            figures(abs(engine / judge(case, quantity) - 1), 1),
        )  # fmt: skip
        apart.append(abs(engine / judge(case, quantity) - 1))
        own.append(
            min(float(r[f"seconds_{k}"]) for r in found if r["name"] == "fem" for k in levels if r[f"seconds_{k}"])
        )
    yield "known values of the four shells at rest to {} or better", figures(max(apart), 1)
    yield "If it refines to its own estimate of convergence, it takes {} to {} s.", *map(duration, (min(own), max(own)))
    thin = {case: row("cross_check", "example_engines", case=case, solver="kratos-thin")["error"] for case in LINEAR}
    yield (
        "Its finest mesh, 128 x 128, is {} off on the plate, {} on the roof, {} on the diaphragm cylinder and {} on the free one",
        *(error(thin[case]) for case in LINEAR),
    )  # fmt: skip
    fem = answer("napkin_plane", "fem", "corner_y_500ms", "cells 8×8", "example_engines")
    flex = [answer("napkin_plane", "mujoco-flex", "corner_y_500ms", label, "example_engines")
            for label in ("cells 20×20", "cells 40×40", "cells 80×80")]  # fmt: skip
    yield (
        "| `fem`, 8 x 8, 1/240 s | {} mm | {} | {} |",
        figures(1000 * abs(fem.absolute_error), 1), duration(fem.seconds), byte_size(fem.storage_bytes),
    )  # fmt: skip
    sizes = [byte_size(r.storage_bytes).partition(" ")[0] for r in flex]
    yield (
        "| `mujoco-flex`, 20 x 20; 40 x 40; 80 x 80 | {}; {}; {} mm | {}; {}; {} | {}; {}; {} MB |",
        *(figures(1000 * abs(r.absolute_error), 2) for r in flex), *(duration(r.seconds) for r in flex), *sizes,
    )  # fmt: skip
    hinges = answer("napkin_plane", "cst-hinge", "corner_y_500ms", "cells 20×20")
    yield "`cst-hinge` is {} mm off on 20 x 20 cells", figures(1000 * abs(hinges.absolute_error), 2)


def mutants():
    """The scores of unseen draws."""
    draws = [d for d in json.loads((ROOT / "references/exam_score.json").read_text())["draws"] if d["unseen"]]
    newest = max(d["seed"] for d in draws)
    last = [d for d in draws if d["seed"] == newest]
    for label, seeds, chosen in (
        ("seed {}, the newest", [newest], last),
        ("all, seeds {} to {}", [min(d["seed"] for d in draws), newest], draws),
    ):
        names = ("drawn", "red", "equivalent", "holes")
        drawn, red, same, holes = (sum(d["mechanics"][name] for d in chosen) for name in names)
        shares = red / (red + holes), beta.ppf(0.025, red, holes + 1), beta.ppf(0.975, red + 1, holes)
        row = f"| {label} | {{}} | {{}} | {{}} | {{}} | {{}} % | {{}} to {{}} % |"
        yield row, *seeds, drawn, red, same, holes, *(f"{100 * share:.0f}" for share in shares)


SOURCES = (
    mutants, the_course, what_fell_short, quoted_figures, circulating_figures, collapse, published_training, natural_gradient, seeds_of_training, strain_measures, motions, costs, findings, engines,
)  # fmt: skip


def whole_table(suite):
    """The table of a suite as `shellbench table --suite` prints it from the kept records, without variants and notes."""
    records = objects("course" if suite == "obstacle_course" else "example")
    asked = [r for r in records if suite in r.suites and VARIANT not in r.case]
    found = [r.model_copy(update={"suite": suite, "suites": (suite,)}) for r in asked]
    lines = tables.render(found, "text").splitlines()
    last = max(k for k, line in enumerate(lines) if line.startswith("---"))
    return "\n".join(lines[: last + 1]) + "\n"


def printed_table(page):
    (found,) = (body for kind, body in FENCED.findall(page) if kind == "text" and "\n---" in body)
    return found


@cache
def read(path):
    return path.read_text(encoding="utf-8")


def everything():
    """The text of all held pages."""
    return "\n\n".join(read(path) for path in PAGES)


def flat(text):
    return " ".join(text.split())


def prose(page):
    """A page without code, links and pictures, in one line."""
    return flat(re.sub(r"`[^`]*`|\]\([^)]*\)", lambda m: m[0] if m[0][0] == "`" else "]", FENCED.sub("", page)))


def sentences(source):
    for template, *values in source():
        yield flat(template), [str(value) for value in values]


def wrong(source, text):
    """Return the sentences that the pages should have, and do not."""
    text = prose(text)
    should = [template.format(*values) for template, values in sentences(source)]
    return [sentence for sentence in should if sentence not in text]


@pytest.mark.parametrize("suite", TABLES)
def test_a_whole_table_is_what_the_examples_records_print(suite):
    assert printed_table(read(TABLES[suite])) == whole_table(suite), "write it anew by `python -m tests.test_readme`"


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: source.__name__)
def test_figures_are_those_of_their_file(source):
    assert wrong(source, everything()) == []


def unheld(page):
    """Return the surroundings of numbers that neither a file nor `DEFINED` accounts for."""
    text = prose(MADE.sub("", page))
    for source in SOURCES:
        for template, values in sentences(source):
            text = text.replace(template.format(*values), template.replace("{}", "#"))
    text = re.sub(r"`[^`]*`|\[[^]]*\]|<details[^>]*>", "#", text)
    for pattern in DEFINED:
        text = re.sub(pattern, "#", text)
    return [text[max(0, m.start() - 40) : m.end() + 40] for m in re.finditer(r"(?<![A-Za-z-])\d[\d.e-]*", text)]


@pytest.mark.parametrize("path", [path for path in PAGES if path != INDEX], ids=lambda path: path.stem)
def test_no_figure_is_without_a_file(path):
    page = read(path)
    assert unheld(page) == []
    assert len(unheld(f"{page}\n\nIt errs by 7.7 %.\n")) == 1


def not_on_their_page(index):
    """Numbers of the list of findings that the page of their line does not have."""
    lines = re.findall(r"^\| \[[^]]*\]\(([^)]*)\) \| (.*) \|$", index, re.MULTILINE)
    pages = [(sentence, set(NUMBER.findall(read(FINDINGS / link)))) for link, sentence in lines]
    return [number for sentence, told in pages for number in NUMBER.findall(sentence) if number not in told]


def test_the_list_of_findings_has_numbers_of_their_pages():
    index = read(INDEX)
    assert not_on_their_page(index) == []
    assert not_on_their_page(index.replace("44 % off", "45 % off")) == ["45"]


def test_no_defined_number_is_out_of_use():
    """A pattern without a use on any page would only hide a number."""
    text = prose(everything())
    assert [pattern for pattern in DEFINED if not re.search(pattern, text)] == []


def test_a_figure_that_is_changed_is_seen():
    text = everything()
    off = text.replace("427 to 582 s", "428 to 582 s")
    assert wrong(published_training, off) == ["A training takes 427 to 582 s on a CPU"]
    off = text.replace("| 0.487482319281 m |", "| 0.487482319282 m |")
    assert len(wrong(the_course, off)) == 1
    off = text.replace("2.1 to 2.5 times fewer", "2.1 to 16 times fewer")
    assert len(wrong(costs, off)) == 2


def write():
    """Write the whole tables, and those of the README and of the start page, anew."""
    for suite, path in TABLES.items():
        path.write_text(read(path).replace(printed_table(read(path)), whole_table(suite)), encoding="utf-8")
    lines = {values[0]: template.format(*values) for template, values in sentences(the_course)}
    for page in PAGES[:2]:
        old = read(page).splitlines()
        new = (lines.get(line[1:].partition("|")[0].strip(), line) for line in old)
        page.write_text("\n".join(new) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write()
