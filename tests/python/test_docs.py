"""The documents: links lead somewhere, errors are those of the program, the site builds and asks nobody for anything.

Building the site needs docs/build/requirements.txt beside the running Python and is skipped without, and unless
MAMMOTWIN_SLOW=1 asks for it.
"""

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("python/*.md")])
slow = pytest.mark.skipif(not os.environ.get("MAMMOTWIN_SLOW"), reason="half a minute; ask for it by MAMMOTWIN_SLOW=1")


def tokens(text):
    markdown = pytest.importorskip("markdown_it").MarkdownIt().enable("table")
    for token in markdown.parse(text):
        yield token
        yield from token.children or []


def anchors(path):
    """Anchors of the headings of a page, as GitHub and the site make them."""
    found, heading = set(), False
    for token in tokens(path.read_text()):
        if token.type == "inline" and heading:
            words = "".join(child.content for child in token.children)
            found.add(re.sub(r"[^\w\- ]", "", words.lower()).replace(" ", "-"))
        heading = token.type == "heading_open"
    return found


def links(path):
    for token in tokens(path.read_text()):
        for name in ("href", "src"):
            target = token.attrGet(name)
            if target and not re.match(r"[a-z]+:", target):
                yield unquote(target)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_a_file_and_a_heading(page):
    for link in links(page):
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        assert target.exists(), f"{link}: no such file"
        assert target.is_relative_to(ROOT), f"{link}: outside of the project"
        if anchor:
            assert anchor in anchors(target), f"{link}: no such heading; there are {sorted(anchors(target))}"


def test_every_page_is_in_the_site():
    menu = set(re.findall(r": ([\w-]+\.md)$", (ROOT / "mkdocs.yml").read_text(), flags=re.MULTILINE))
    assert menu == {page.name for page in (ROOT / "docs").glob("*.md")}


def source():
    """The texts of the program, each in one line."""
    files = [*ROOT.glob("*/src/**/*.rs"), ROOT / "scripts/cohort"]
    text = "\n".join(path.read_text() for path in sorted(files))
    return re.sub(r"\\\n\s*", "", text).replace('\\"', '"')


def test_errors_are_those_of_the_program():
    """Every part of a message between two `…` is in the sources, in this order."""
    rows = re.findall(r"^\| `(.*?)` \|", (ROOT / "docs/errors.md").read_text(), flags=re.MULTILINE)
    messages = [message for message in rows if re.search(r"[a-z]{3}", message)]
    assert len(messages) > 40
    text = source()
    # What the operating system says is not ours.
    foreign = {"No space left on device"}
    missing = []
    for message in set(messages) - foreign:
        parts = [re.escape(part) for part in message.split("…") if part.strip(" :()")]
        if not re.search(r"[^\n]*?".join(parts), text):
            missing.append(message)
    assert not missing, "not in the sources"


def test_the_study_of_the_guide_is_one(tmp_path):
    """On the images of a digital volunteer; needs her run folder, MAMMOTWIN_RESULTS, and the program."""
    program = Path(os.environ.get("MAMMOTWIN", ROOT / "target/release/mammotwin")).resolve()
    volunteer = Path(os.environ.get("MAMMOTWIN_RESULTS", "none")).resolve().parent.parent
    if not program.exists() or not (volunteer / "tilted.nii.gz").exists():
        pytest.skip("no program, or no volunteer of three poses")
    (text,) = re.findall(r"```toml\n(.*?)```", (ROOT / "docs/guide.md").read_text(), flags=re.DOTALL)
    (tmp_path / "study.toml").write_text(text)
    for path in [*volunteer.glob("*.nii.gz"), *volunteer.glob("*_landmarks.csv")]:
        (tmp_path / path.name).symlink_to(path)
    done = subprocess.run([program, "check", tmp_path / "study.toml"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def tables_of_the_study():
    """By the heading of docs/study.md, the keys that are in its table."""
    text = (ROOT / "docs/study.md").read_text()
    for heading, part in re.findall(r"^##+ (.*)\n((?:(?!^#).*\n)*)", text, flags=re.MULTILINE):
        yield heading, set(re.findall(r"^\| `(\w+)` \|", part, flags=re.MULTILINE))


@pytest.mark.parametrize("heading, keys", [pytest.param(*table, id=table[0]) for table in tables_of_the_study()])
def test_the_keys_of_a_study_are_those_of_the_program(heading, keys, tmp_path):
    """The program names the keys of a table when it meets one that it does not know."""
    program = Path(os.environ.get("MAMMOTWIN", ROOT / "target/release/mammotwin")).resolve()
    if not program.exists():
        pytest.skip("no program")
    names = {"The whole file": "", "poses.NAME": "poses.supine", "scans.NAME": "scans.upright", "records.SIDE": "records.right"}
    names |= {"model.arms.NAME": "model.arms.upright"}
    names |= {"model.skin, model.fascia": "model.skin", "constants": "model.breast.constants"}
    table = names.get(heading, heading)
    lists = {"mammogram.masses", "model.arms.upright"}
    head = f"[[{table}]]\n" if table in lists else f"[{table}]\n" if table else ""
    (tmp_path / "study.toml").write_text(f"{head}nonesuch = 1\n")
    done = subprocess.run([program, "check", tmp_path / "study.toml"], capture_output=True, text=True)
    told = re.search(r"nonesuch: unknown key; there are: (.*)", done.stderr)
    assert told, done.stderr
    assert set(told.group(1).split(", ")) == keys


class Requests(HTMLParser):
    """What a page would load from elsewhere."""

    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attributes):
        told = dict(attributes)
        loads = told.get("src") or (told.get("href") if tag == "link" and told.get("rel") != "canonical" else None)
        if loads and re.match(r"(https?:)?//", loads):
            self.found.append(loads)


@slow
def test_the_site_builds_without_a_broken_link_and_needs_no_network(tmp_path):
    pytest.importorskip("material")
    pytest.importorskip("ziamath")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", tmp_path]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    pages = list(tmp_path.glob("**/*.html"))
    assert {"theory.html", "guide.html", "calibration.html"} <= {page.name for page in pages}
    for page in pages:
        parser = Requests()
        parser.feed(page.read_text())
        assert not parser.found, f"{page.name}: {parser.found}"
    theory = (tmp_path / "theory.html").read_text()
    assert theory.count('<svg class="equation"') > 50 and "arithmatex" not in theory
