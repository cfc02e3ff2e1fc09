"""Sessions: the main job, the tests, and checks of the code. `python -m nox -l` lists them."""

import platform
import shutil
import sys
from pathlib import Path

import nox

nox.options.sessions = ["obstacle_course"]
nox.options.reuse_existing_virtualenvs = True

CONSTRAINTS = ("-c", "constraints.txt")
QUICK_SOLVERS = ("--solver", "fem", "--solver", "ndf-ritz", "--seed", "0")
GATES = ("--regression", "--cost")  # what is reported unless it is asked to be judged
STUDIES = ("resolution", "thinness", "sampling", "training")
PINNED_EXTRAS = ("compiled", "vtk", "test", "docs", "lint")  # `fast` is Intel's alone
PINNED = "# Versions that CI installs: pip install -c constraints.txt . Written by: python -m nox -s constraints\n"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
LARGE = ("newton", "ngsolve")  # plug-ins whose programs are large: the quick session leaves them out
PLUGINS = (
    "calculix",
    "dask",
    "kratos",
    "mujoco",
    "nastran",
    "newton",
    "ngsolve",
    "opensees",
)  # packages below plugins/
CALIBRATED = ("obstacle_course", "verification", "shapes", "variants", "thinness")  # the linear shells
ONE_THREAD = ("--threads", "1")  # as many runs at a time as there are cores: none waits where others can't share work
SPEED = "rope_speed"  # whose runs are made one at a time: none waits for memory that others use
DRAWN, CALIBRATION_STORE = "reports/calibration/cases", "reports/calibration/runs"
ENGINES_STORE = "reports/engines"  # of its own: runs with one thread beside runs with two would share no environment
WITHOUT_AVX512 = {
    "OPENBLAS_CORETYPE": "Haswell",
    "MKL_CBWR": "AVX2",
    "ATEN_CPU_CAPABILITY": "avx2",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
}
OLD_PROCESSOR = {
    "OPENBLAS_CORETYPE": "Prescott",
    "MKL_CBWR": "COMPATIBLE",
    "ATEN_CPU_CAPABILITY": "default",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
}
CONDITIONS: dict[str, tuple[tuple[str, ...], dict[str, str]]] = {
    "one-thread": (("--threads", "1"), {}),
    "four-threads": (("--threads", "4"), {}),
    "without-avx512": ((), WITHOUT_AVX512),
    "old-processor": ((), OLD_PROCESSOR),
}
REPORT = "reports/latest"
PAPER = "reports/paper"
PAGES = "reports/pages"


def install(session: nox.Session, *extras: str) -> None:
    target = f".[{','.join(extras)}]" if extras else "."
    session.install("-q", "-e", target, *CONSTRAINTS)


def plugins_here() -> tuple[str, ...]:
    """Return the plug-ins that can be installed: Kratos has wheels for x86-64 Linux only."""
    has_kratos = sys.platform == "linux" and platform.machine() == "x86_64"
    return PLUGINS if has_kratos else tuple(name for name in PLUGINS if name != "kratos")


def install_plugins(session: nox.Session, *names: str) -> None:
    for name in names:
        session.install("-q", "-e", f"./plugins/{name}[test]", *CONSTRAINTS)


def pinned(frozen: str) -> str:
    """Return the file of constraints from the output of `pip freeze`, without local versions and folders."""
    lines = (line.strip() for line in frozen.splitlines())
    kept = {line.partition("+")[0] for line in lines if "==" in line and not line.startswith(("#", "-", "shellbench="))}
    return PINNED + "".join(f"{line}\n" for line in sorted(kept, key=lambda line: line.partition("==")[0].lower()))


@nox.session
def obstacle_course(session: nox.Session) -> None:
    """Solve four shells at rest, a sleeve that buckles and a napkin in motion; print, report, judge. `-- --quick`.

    With `--quick` only `fem` and `ndf-ritz` solve all six. Its suites also have separate sessions. The session judges
    accuracy; `-- --regression` also compares the values with the baseline.
    """
    run_and_judge(session, "obstacle_course")


@nox.session
def verification(session: nox.Session) -> None:
    """Solve what the obstacle course can't test: prescribed motion, reactions, clamps, curved coordinate lines."""
    run_and_judge(session, "verification")


@nox.session
def shapes(session: nox.Session) -> None:
    """Solve oblique, doubly curved, slender and pressed shells, and judge. `-- --quick` for one seed of `ndf-ritz`."""
    run_and_judge(session, "shapes")


@nox.session
def folds(session: nox.Session) -> None:
    """Solve and judge shells with folds: plates at an angle, boxes, a corrugated sheet, Raasch's hook and LE5."""
    run_and_judge(session, "folds")


@nox.session
def benchmarks(session: nox.Session) -> None:
    """Solve beams and plates of other sets of benchmarks, and judge. `-- --quick`."""
    run_and_judge(session, "benchmarks")


@nox.session
def modes(session: nox.Session) -> None:
    """Ask shells for frequencies of small vibrations, and judge. `-- --quick` for one seed of `ndf-ritz`."""
    run_and_judge(session, "modes")


@nox.session
def buckling(session: nox.Session) -> None:
    """Ask shells for the loads at which they buckle, and judge. `-- --quick` for one seed of `ndf-ritz`."""
    run_and_judge(session, "buckling")


@nox.session
def resultants(session: nox.Session) -> None:
    """Ask shells for membrane forces, moments and shear forces, and judge. `-- --quick` for one seed of `ndf-ritz`."""
    run_and_judge(session, "resultants")


@nox.session
def variants(session: nox.Session) -> None:
    """Solve variants of other suites' shells (axes, frame, units, coordinates), and judge. `-- --quick`."""
    run_and_judge(session, "variants")


@nox.session
def contact(session: nox.Session) -> None:
    """Press strips and a plate onto rigid obstacles, and judge."""
    run_and_judge(session, "contact")


@nox.session
def garments(session: nox.Session) -> None:
    """Let a skirt and a flag fall in the wind, and judge."""
    run_and_judge(session, "garments")


@nox.session
def passport(session: nox.Session) -> None:
    """Measure the stiffness of solvers, including hinges and MuJoCo's cloth: a swatch, a hanging strip."""
    run_and_judge(session, "passport", plugged=("mujoco",))


@nox.session
def woven(session: nox.Session) -> None:
    """Solve orthotropic plates, a swatch, a tube and strips along warp, weft and bias, and judge them. `-- --quick`."""
    run_and_judge(session, "woven")


@nox.session
def meshes(session: nox.Session) -> None:
    """Ask for shells whose surfaces are meshes, and judge."""
    run_and_judge(session, "meshes")


@nox.session
def shape_variants(session: nox.Session) -> None:
    """Solve variants of all shells of the suite `shapes` by `fem`, and judge."""
    run_and_judge(session, "shape_variants")


@nox.session
def calibration(session: nox.Session) -> None:
    """Compare stated uncertainties with true errors: all linear shells, their variants, and 48 drawn ones.

    The solvers are `fem` and one seed of `ndf-ritz`; `-- --solver NAME` selects others. The page has the table and the
    figure.
    """
    install(session)
    session.run("python", "-m", "derivations.drawn_shells", DRAWN)
    drawn = sorted(str(path) for path in Path(DRAWN).glob("drawn_*.toml"))
    suites = [option for name in CALIBRATED for option in ("--suite", name)]
    solvers = tuple(session.posargs) or QUICK_SOLVERS
    for asked in (suites, drawn):
        session.run("shellbench", "run", *asked, *solvers, "--store", CALIBRATION_STORE, success_codes=[0, 1])
    session.run("shellbench", "report", "--store", CALIBRATION_STORE, "--no-print", "--out", REPORT)
    session.run("shellbench", "gate", "--store", CALIBRATION_STORE)


@nox.session
def nonlinear(session: nox.Session) -> None:
    """Follow ten shells to large displacements, and judge. `-- --quick` for `fem` and one seed of `ndf-ritz`."""
    run_and_judge(session, "nonlinear")


@nox.session
def cloth(session: nox.Session) -> None:
    """Let cloth fall, swing and buckle by Newton's law and the published functional; judge. `-- --quick`: `fem`."""
    beside = () if "--quick" in session.posargs else ("published_motion",)
    run_and_judge(session, "cloth", beside, quick=("--solver", "fem"))


@nox.session
def rope(session: nox.Session) -> None:
    """Let chains and loose masses move, and judge; studies of steps, sweeps and pushes are shown. `-- --quick`.

    The studies include MuJoCo's chain, and steps a second.
    """
    beside = () if "--quick" in session.posargs else ("rope_convergence", "rope_collision", SPEED)
    extras, engine = (("compiled",), ("mujoco",)) if beside else ((), ())
    quick = ("--solver", "rope-exact", "--solver", "pendulum-ode")
    run_and_judge(session, "rope", beside, quick=quick, extras=extras, plugged=engine)


@nox.session
def editing(session: nox.Session) -> None:
    """Edit shells (force, pose, thickness), from the earlier solution and from scratch, and judge the answers."""
    run_and_judge(session, "editing", quick=("--solver", "fem-edit"))


@nox.session
def naghdi(session: nox.Session) -> None:
    """Train a network for shells whose normals shear, and judge it by values of that theory."""
    run_and_judge(session, "naghdi", quick=("--solver", "pinn-naghdi", "--set", "pinn-naghdi.iterations=100"))


@nox.session
def naghdi_limits(session: nox.Session) -> None:
    """Solve shells whose normals shear, on hard and soft supports, and judge."""
    run_and_judge(session, "naghdi_limits", quick=("thick_plate_naghdi", "scordelis_lo@naghdi_soft"))


@nox.session
def skinning(session: nox.Session) -> None:
    """Skin a simulated cape from bones by lines and by networks; nothing is judged. `-- --solver NAME` asks fewer.

    The first run simulates the clips, which takes half a minute; no method's time counts that.
    """
    install(session)
    session.run("shellbench", "run", "--suite", "skinning", *ONE_THREAD, *session.posargs, success_codes=[0, 1])
    session.run("shellbench", "table", "--suite", "skinning")
    session.run("shellbench", "report", "--suite", "skinning", "--out", REPORT)
    session.log(f"{REPORT}/index.html")


@nox.session
def field(session: nox.Session) -> None:
    """Fit fields on grids, samplers and bodies of vertices, and judge; studies are shown. `-- --quick`."""
    beside = () if "--quick" in session.posargs else ("sampling_bias", "field_training")
    quick = ("grid", "grid-adaptive", "inverse-transform", "nearest-vertex")
    run_and_judge(session, "field", beside, quick=tuple(word for name in quick for word in ("--solver", name)))


@nox.session
def drape(session: nox.Session) -> None:
    """Let a cloth fall on three bodies by a grid and a mesh, and judge; studies are shown. `-- --quick`: the grid."""
    beside = () if "--quick" in session.posargs else ("bodies", "field_epochs", "field_fold_directions")
    run_and_judge(session, "drape", beside, quick=("--solver", "grid"))


def run_and_judge(
    session: nox.Session,
    suite: str,
    beside: tuple[str, ...] = (),
    quick: tuple[str, ...] = QUICK_SOLVERS,
    extras: tuple[str, ...] = (),
    plugged: tuple[str, ...] = (),
) -> None:
    """Run a suite, show it with others that are not judged, and judge it."""
    install(session, *extras)
    install_plugins(session, *plugged)
    arguments = list(session.posargs)
    narrowed: tuple[str, ...] = ()
    if "--quick" in arguments:
        arguments.remove("--quick")
        narrowed = quick
    judged = [option for option in arguments if option in GATES]  # for the gate only
    arguments = [argument for argument in arguments if argument not in GATES]
    # A failed run must not keep the table and the verdict from the user: the gate turns red over it.
    session.run("shellbench", "run", "--suite", suite, *narrowed, *ONE_THREAD, *arguments, success_codes=[0, 1])
    for other in beside:
        alone = ("--jobs", "1") if other == SPEED else ()
        session.run("shellbench", "run", "--suite", other, *ONE_THREAD, *alone, *arguments, success_codes=[0, 1])
    shown = [option for name in (suite, *beside) for option in ("--suite", name)]
    session.run("shellbench", "table", *shown)
    session.run("shellbench", "report", *shown, "--no-print", "--out", REPORT)
    session.run("shellbench", "gate", "--suite", suite, *narrowed, *judged)


@nox.session
def ablations(session: nox.Session) -> None:
    """Run the ablations of the preprint's Table 3 and print them; nothing is gated."""
    install(session)
    session.run("shellbench", "run", "--suite", "ablations", *session.posargs, success_codes=[0, 1])
    session.run("shellbench", "table", "--suite", "ablations")


@nox.session
def strain_ablation(session: nox.Session) -> None:
    """Solve with linear, published and exact strains, and compare them; nothing is gated."""
    install(session)
    session.run("shellbench", "run", "--suite", "strain_ablation", *session.posargs, success_codes=[0, 1])
    session.run("shellbench", "table", "--suite", "strain_ablation")
    session.run("shellbench", "report", "--suite", "strain_ablation", "--out", REPORT)


@nox.session
def evidence(session: nox.Session) -> None:
    """Study resolution, memory, cost, training, sampling and thinness, and show the results with the obstacle course.

    The session rewrites reports/resolution.json, the summary of the resolution of the course's shells, to be committed.
    """
    install(session)
    install_plugins(session, "mujoco")
    suites = [option for name in ("obstacle_course", *STUDIES) for option in ("--suite", name)]
    # some runs of the studies fail on purpose: a field on too few points is refused, and that is a finding
    session.run("shellbench", "run", *suites, *session.posargs, success_codes=[0, 1])
    session.run("python", "docs/evidence.py", "resolution")
    session.run("shellbench", "report", *suites, "--out", REPORT)


@nox.session
def plugins(session: nox.Session) -> None:
    """Install the packages below plugins/ and run their tests. `-- --quick`: quick ones, without large programs."""
    install(session, "test")
    quick = ("-m", "not long") if "--quick" in session.posargs else ()
    names = tuple(name for name in plugins_here() if not (quick and name in LARGE))
    install_plugins(session, *names)
    session.run("python", "-m", "pytest", *quick, *(f"plugins/{name}" for name in names))


@nox.session
def engines(session: nox.Session) -> None:
    """Install the plug-ins, test them, and compare the built-in solvers, Kratos and MuJoCo with known values.

    All runs have one core each and are made one at a time, so that the table can compare seconds. Arguments after `--`
    go to `shellbench run`. Runs are kept in reports/engines. Seconds are compared only if one command measured all of
    them: `-- --force` repeats all runs. The page is reports/pages/example_engines/index.html.
    """
    plugins(session)
    one_core = ("--jobs", "1", "--threads", "1", "--store", ENGINES_STORE, *session.posargs)
    for suite in ("engines", "motion_engines"):
        session.run("shellbench", "run", "--suite", suite, *one_core, success_codes=[0, 1])
    shown = ("--store", ENGINES_STORE, "--suite", "engines", "--suite", "motion_engines")
    session.run("shellbench", "table", *shown)
    session.run("shellbench", "report", *shown, "--out", f"{PAGES}/example_engines")
    session.run("shellbench", "gate", "--store", ENGINES_STORE, "--suite", "engines")


@nox.session
def board(session: nox.Session) -> None:
    """Solve the shells of the board by the elements of other programs, and write docs/board/. `-- --solver NAME`.

    What is in docs/board/figures.json is kept; `-- --again` solves it again. CalculiX (`ccx`) and MYSTRAN are taken
    from the PATH; without them their elements keep their figures.
    """
    install(session, "compiled")
    install_plugins(session, *plugins_here())
    session.run("python", "-m", "docs.board", "run", *session.posargs)
    session.run("python", "-m", "docs.board", "page")


@nox.session
def example(session: nox.Session) -> None:
    """Build the large example page, and copy the evidence for README and docs from it and from that of `engines`.

    The published training, which takes long, comes from its kept records.
    """
    install(session)
    suites = (
        "obstacle_course",
        "verification",
        "ablations",
        "nonlinear",
        "strain_ablation",
        "cloth",
        "published_motion",
        *STUDIES,
    )
    for suite in suites:
        command = ("shellbench", "run", "--suite", suite, "--jobs", "1", *session.posargs)
        session.run(*command, success_codes=[0, 1])  # a strain measure that fails is part of the example
    shown = [option for name in (*suites, "published", "replication") for option in ("--suite", name)]
    kept_trainings(session, "reports/runs")
    session.run("shellbench", "report", *shown, "--out", f"{PAGES}/example")
    session.run("python", "docs/evidence.py")
    session.log("tests/test_readme.py says which figures of README and docs have moved")


@nox.session
def replication(session: nox.Session) -> None:
    """Show the published training as printed and repaired, from its kept records, with the published figures."""
    install(session)
    store = "reports/replication_runs"
    kept_trainings(session, store)
    session.run("shellbench", "table", "--suite", "replication", "--store", store)
    session.run("shellbench", "report", "--suite", "replication", "--store", store, "--out", REPORT)
    session.log(f"{REPORT}/index.html")


def kept_trainings(session: nox.Session, store: str) -> None:
    """Copy the kept trainings into a store, after a check of 50 iterations of each against the present code."""
    session.run("python", "-m", "tests.solvers.ndf.kept_trainings")
    for folder in ("reports/published", "reports/replication"):
        shutil.copytree(folder, store, dirs_exist_ok=True, ignore=shutil.ignore_patterns("*.md", "*.jsonl"))


@nox.session
def paper(session: nox.Session) -> None:
    """Write tables and figures for LaTeX from the obstacle course. `-- --suite NAME` for others, may be repeated."""
    install(session)
    chosen = tuple(session.posargs) or ("--suite", "obstacle_course")
    session.run("shellbench", "run", *chosen, success_codes=[0, 1])  # what has a record already is kept
    session.run("shellbench", "report", *chosen, "--paper", PAPER)
    if not shutil.which("pdflatex"):
        session.log(f"pdflatex is not installed: {PAPER}/paper.tex is written, and not compiled")
        return
    session.chdir(PAPER)
    for tool in ("pdflatex", "bibtex", "pdflatex", "pdflatex"):  # the last two settle citations and page numbers
        quiet = ("-interaction=batchmode",) if tool == "pdflatex" else ("-terse",)
        good = [0] if tool == "pdflatex" else [0, 2]  # bibtex objects to a document that cites nothing
        session.run(tool, *quiet, "paper", external=True, success_codes=good)


@nox.session
def tests(session: nox.Session) -> None:
    """Run the quick tests, in parallel."""
    install(session, "test", "compiled")
    if not any(map(shutil.which, BROWSERS)):
        session.run("playwright", "install", "chromium", silent=True, success_codes=range(256))  # else tests say so
    # Work is stolen from the end: tests of one file stay together, and what they share is made once.
    session.run("pytest", "-n", "auto", "--dist", "worksteal", "-m", "not long", *session.posargs)


@nox.session
def long(session: nox.Session) -> None:
    """Run the tests that take more than a few seconds each: accuracy, injected faults, killed runs."""
    install(session, "test", "compiled")
    session.run("pytest", "-n", "2", "--dist", "worksteal", "-m", "long", *session.posargs)


@nox.session
def mutation(session: nox.Session) -> None:
    """Test the exam: judge mutants of the built-in solvers, and print the survivors. Takes hours.

    `-- --seed 8 --count 25 --solver fem --kind mechanics` draws some. Results are kept in reports/mutation.
    """
    install(session, "test")
    session.run("pytest", "-q", "tools/mutation")
    session.run("python", "-m", "tools.mutation", *session.posargs)


@nox.session
def bench(session: nox.Session) -> None:
    """Measure ratios of costs, each within one run."""
    install(session, "test", "compiled")
    session.run("pytest", "tests/benchmarks", "--benchmark-enable", "--benchmark-only", *session.posargs)


@nox.session
def repeatability(session: nox.Session) -> None:
    """Measure changes of gated values between emulated processors and numbers of threads, and show the new baseline.

    `-- SUITE` for another suite than the obstacle course; `-- --write` moves the baseline. There is one store for each
    condition, with one seed: differences between seeds are known from the suite itself.
    """
    install(session)
    arguments = list(session.posargs)
    write = ("--write",) if "--write" in arguments else ()
    suite = next((a for a in arguments if a != "--write"), "obstacle_course")
    session.run("shellbench", "run", "--suite", suite)
    like: list[str] = []
    for name, (options, emulated) in CONDITIONS.items():
        store = f"reports/repeatability/{name}"
        session.run("shellbench", "run", "--suite", suite, "--store", store, "--seed", "0", *options, env=emulated)
        like += ["--like", store]
    session.run("shellbench", "baseline", "--suite", suite, *like, *write)


@nox.session
def case_pages(session: nox.Session) -> None:
    """Write a page and a figure for each case into docs/cases, as `docs` does; `-- CASE` writes some only."""
    install(session)
    session.run("python", "docs/cases.py", "--store", "reports/runs", *session.posargs)


@nox.session
def docs(session: nox.Session) -> None:
    """Build the site in site/ without a network; a link or an anchor that leads nowhere is an error."""
    build_site(session)


@nox.session
def accessibility(session: nox.Session) -> None:
    """Build the site and check each page with axe-core, wide and narrow, light and dark. `-- --page NAME`: fewer."""
    build_site(session)
    if not any(map(shutil.which, BROWSERS)):
        session.run("playwright", "install", "chromium", silent=True)
    session.run("python", "docs/accessibility.py", "site", *session.posargs)


def build_site(session: nox.Session) -> None:
    """Build the pages of the cases, then the site; not with --quiet, which keeps --strict from seeing warnings."""
    install(session, "docs")
    session.run("python", "docs/cases.py", "--store", "reports/runs")
    session.run("mkdocs", "build", "--strict", env={"NO_MKDOCS_2_WARNING": "1"})
    session.log("site/index.html")


@nox.session(reuse_venv=False)
def constraints(session: nox.Session) -> None:
    """Pin the newest versions of all packages of the extras in constraints.txt. Test them before you commit it.

    `-- --check` installs the pinned versions, and lists missing ones.
    """
    check = "--check" in session.posargs

    folders = [f".[{','.join(PINNED_EXTRAS)}]", *(f"./plugins/{name}" for name in PLUGINS)]
    session.install("-q", *folders, *(CONSTRAINTS if check else ()))
    found = pinned(session.run("python", "-m", "pip", "freeze", silent=True))
    file = Path("constraints.txt")
    if check:
        lacking = sorted(set(found.splitlines()) - set(file.read_text(encoding="utf-8").splitlines()))
        if lacking:
            session.error(f"constraints.txt lacks {', '.join(lacking)}: write it by `python -m nox -s constraints`")
    else:
        file.write_text(found, encoding="utf-8")
        session.log("constraints.txt is written: run the tests with it, then commit it")


@nox.session
def package(session: nox.Session) -> None:
    """Build wheel and sdist in dist/, install the wheel alone, and try it outside of the repository."""
    session.install("-q", "hatchling", *CONSTRAINTS)
    shutil.rmtree("dist", ignore_errors=True)
    session.run("python", "-m", "hatchling", "build", "-d", "dist")
    wheel = next(Path("dist").glob("*.whl")).resolve()
    session.install("-q", str(wheel), *CONSTRAINTS)
    session.chdir(session.create_tmp())
    for command in ("doctor", "list square_plate", "run square_plate --solver fem", "table", "gate"):
        session.run("shellbench", *command.split())


@nox.session
def lint(session: nox.Session) -> None:
    """Check style and types."""
    install(session, "lint")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")
    session.run("mypy")
