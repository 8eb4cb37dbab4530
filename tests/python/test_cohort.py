"""The cohort workflow: planned on any machine; run here, and by a real Slurm that is disturbed, in the slow tests.

The quick test needs Snakemake beside the running Python. The slow ones are asked for by MAMMOTWIN_SLOW=1; they need the
program (MAMMOTWIN) as well, and one of them the Debian packages slurmctld, slurmd, slurm-client and munge.
"""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest
from slurm import Impossible, Slurm

pytest.importorskip("snakemake")
ROOT = Path(__file__).resolve().parents[2]
PROGRAM = Path(os.environ.get("MAMMOTWIN", ROOT / "target/release/mammotwin")).resolve()
SNAKEMAKE = str(Path(sys.executable).parent / "snakemake")
VOLUNTEERS = [f"{number:02}" for number in range(1, 9)]
#: Those whom a cluster computes while it is disturbed.
FEW = VOLUNTEERS[:4]
DISTANCES = (15, 20)
#: Stages that know no paddle, and those that do.
BODY = {"segment:supine", "surface:supine", "mesh", "calibrate"}
PADDLE = {"compress", "comfort", "mammogram", "quality"}
slow = pytest.mark.skipif(not os.environ.get("MAMMOTWIN_SLOW"), reason="minutes; ask for it by MAMMOTWIN_SLOW=1")


def command(cohort, *options):
    return [ROOT / "scripts/cohort", cohort / "cohort.yaml", *options]


def run(cohort, *options, environment=None):
    environment = {**(environment or os.environ), "SNAKEMAKE": SNAKEMAKE}
    return subprocess.run(command(cohort, *options), env=environment, capture_output=True, text=True)


def write_cohort(folder, bids, **more):
    told = {"bids": bids, "template": "template.toml", "program": PROGRAM, "paddles": "[rigid]"}
    told |= {"chest_wall_distances_mm": list(DISTANCES), "mem_mb": 1000} | more
    folder.mkdir(exist_ok=True)
    (folder / "cohort.yaml").write_text("".join(f"{key}: {value}\n" for key, value in told.items()))
    (folder / "template.toml").write_text((ROOT / "workflows/template.toml").read_text())
    return folder


def test_every_participant_meets_every_paddle_at_every_distance(tmp_path):
    for number in range(3):
        anat = tmp_path / f"bids/sub-{number}/anat"
        anat.mkdir(parents=True)
        (anat / f"sub-{number}_acq-supine_T1w.nii.gz").touch()
    write_cohort(tmp_path, "bids", paddles="[rigid, elastic]")
    planned = run(tmp_path, "local", "--dry-run")
    assert planned.returncode == 0, planned.stderr
    jobs = dict(re.findall(r"^(\w+) +(\d+)$", planned.stdout + planned.stderr, flags=re.MULTILINE))
    assert jobs == {"template": "4", "participant": "12", "group": "4", "cohort": "1", "all": "1", "total": "22"}
    # A sidecar that holds for all is read by all.
    (tmp_path / "bids/acq-supine_T1w.json").write_text("{}")
    planned = run(tmp_path, "local", "--dry-run")
    assert planned.stdout.count("bids/acq-supine_T1w.json") == 12, planned.stdout + planned.stderr
    write_cohort(tmp_path, "bids", paddle="rigid")
    refused = run(tmp_path, "local", "--dry-run")
    assert refused.returncode != 0 and "'paddle' was unexpected" in refused.stdout + refused.stderr


@pytest.fixture(scope="module")
def volunteers(tmp_path_factory):
    """A synthetic cohort, made by the command of the documents."""
    if not PROGRAM.exists():
        pytest.skip(f"{PROGRAM}: no program; build it, or set MAMMOTWIN")
    folder = tmp_path_factory.mktemp("cohort")
    environment = {**os.environ, "MAMMOTWIN": str(PROGRAM)}
    subprocess.run([ROOT / "workflows/example", folder, str(len(VOLUNTEERS))], env=environment, check=True)
    return folder


@pytest.fixture(scope="module")
def serial(volunteers):
    """Folders of the variants, computed by the program alone, one participant after the other."""
    template = (ROOT / "workflows/template.toml").read_text()
    folders = {}
    for distance in DISTANCES:
        path = volunteers / f"serial-{distance}.toml"
        path.write_text(template.replace("chest_wall_distance_mm = 15.0", f"chest_wall_distance_mm = {distance}.0"))
        out = folders[f"paddle-rigid_distance-{distance}mm"] = volunteers / f"serial-{distance}"
        work = ["--template", path, "--work-dir", volunteers / "serial-work"]
        subprocess.run([PROGRAM, "--quiet", "bids", volunteers / "bids", out, "participant", *work], check=True)
    return folders


def check_groups(cohort, serial, labels):
    for variant, folder in serial.items():
        bids = [PROGRAM, "--quiet", "bids", cohort.parent / "bids", folder]
        subprocess.run([*bids, "group", "--participant-label", *labels], check=True)
        for name in ("group_metrics.tsv", "group_metrics.json", "group.html"):
            found = (cohort / "derivatives" / variant / name).read_bytes()
            assert found == (folder / name).read_bytes(), f"{variant}/{name}"
    lines = (cohort / "derivatives/cohort.tsv").read_text().splitlines()
    assert len(lines) == 1 + len(labels) * len(DISTANCES)
    assert len({tuple(line.split("\t")[:3]) for line in lines}) == len(lines)
    assert all(line.split("\t")[3] == "done" for line in lines[1:])


def computed(cohort, label):
    """How often each stage of a participant was computed to its end, over all jobs."""
    logs = (cohort / "derivatives/logs").glob(f"*/sub-{label}.log")
    return Counter(name for log in logs for name in re.findall(r': computed instance="([^"]+)"', log.read_text()))


def check_nothing_was_lost(cohort, labels):
    for label in labels:
        often = computed(cohort, label)
        assert {name: often[name] for name in BODY} == dict.fromkeys(BODY, 1), label
        assert {name: often[name] for name in PADDLE} == dict.fromkeys(PADDLE, len(DISTANCES)), label


@slow
def test_a_cohort_on_this_machine_is_the_serial_one(volunteers, serial):
    cohort = write_cohort(volunteers / "local", volunteers / "bids")
    done = run(cohort, "local")
    assert done.returncode == 0, done.stderr
    check_groups(cohort, serial, VOLUNTEERS)
    check_nothing_was_lost(cohort, VOLUNTEERS)
    again = run(cohort, "local")
    assert again.returncode == 0 and "Nothing to be done" in again.stderr, "what is there is not computed again"


@slow
def test_input_and_derivatives_are_bids(volunteers):
    """The validator of BIDS finds no error in what the last test made. Warnings are of keys that are recommended."""
    validator = Path(sys.executable).parent / "bids-validator-deno"
    if not validator.exists():
        pytest.skip("no bids-validator-deno")
    folders = [volunteers / "bids", *(volunteers / "local/derivatives").glob("paddle-*")]
    assert len(folders) == 1 + len(DISTANCES)
    # The cache of a run without --work-dir lies among the derivatives.
    (folders[1] / "work/sub-01").mkdir(parents=True)
    (folders[1] / "work/sub-01/study.toml").touch()
    for folder in folders:
        told = subprocess.run([validator, folder, "--format", "json"], capture_output=True, text=True).stdout
        issues = json.loads(told)["issues"]["issues"]
        errors = [issue for issue in issues if issue["severity"] == "error"]
        assert issues and not errors, errors


def until(what, found, seconds=1800):
    end = time.monotonic() + seconds
    while not (value := found()):
        assert time.monotonic() < end, f"no {what} within {seconds} s"
        time.sleep(0.3)
    return value


def processes(cohort):
    """(process, label) of the programs that compute participants of the cohort now."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_bytes().decode(errors="replace").split("\0")
            inside = (folder / "cwd").readlink() == cohort
        except OSError:
            continue
        if inside and words[0] == str(PROGRAM) and "participant" in words:
            yield int(folder.name), words[words.index("--participant-label") + 1]


@slow
def test_disturbances_under_slurm_lose_nothing(volunteers, serial, tmp_path):
    cohort = write_cohort(volunteers / "slurm", volunteers / "bids", participants=json.dumps(FEW))
    quick = ["--slurm-init-seconds-before-status-checks", "2", "--seconds-between-status-checks", "2"]
    quick += ["--latency-wait", "10"]
    try:
        slurm = Slurm(tmp_path / "slurm").__enter__()
    except Impossible as cause:
        pytest.skip(str(cause))
    environment = {**slurm.environment, "SNAKEMAKE": SNAKEMAKE}
    with open(cohort / "driver.log", "wb") as log:
        driver = subprocess.Popen(command(cohort, "slurm", *quick), env=environment, stdout=log, stderr=log)
    try:
        # A second driver is kept away.
        until("running job", slurm.running)
        assert run(cohort, "slurm", *quick, environment=environment).returncode == 75

        # A job is cancelled, as an administrator or a time limit does, ...
        until("program", lambda: list(processes(cohort)))
        job, comment = slurm.running()[0]
        cancelled = re.search(r"participant_wildcards.*_(\d\d)(_|$)", comment).group(1)
        slurm.ask("scancel", job)
        until("word of it", lambda: "CANCELLED" in (cohort / "driver.log").read_text())

        # ... the program of another one is killed, as for want of memory, ...
        process, _ = until("program", lambda: [p for p in processes(cohort) if p[1] != cancelled])[-1]
        os.kill(process, signal.SIGKILL)
        until("word of it", lambda: "FAILED" in (cohort / "driver.log").read_text())

        # ... and the driver, while its jobs run on.
        until("participants that are done", lambda: len(list((cohort / "derivatives").glob("*/*/*_status.json"))) >= 2)
        until("running job", slurm.running)
        driver.kill()
        driver.wait()
        assert slurm.running(), "jobs outlive their driver"

        done = run(cohort, "slurm", *quick, environment=environment)
        assert done.returncode == 0, done.stderr
        check_groups(cohort, serial, FEW)
        check_nothing_was_lost(cohort, FEW)
    finally:
        driver.kill()
        driver.wait()
        slurm.__exit__()
