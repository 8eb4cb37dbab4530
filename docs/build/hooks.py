"""What the site has beyond its pages: equations as pictures, and the notebooks of examples/ as pages."""

import html
import re
from pathlib import Path

import nbformat
import ziafont
import ziamath
from mkdocs.structure.files import File
from nbconvert import MarkdownExporter

ROOT = Path(__file__).resolve().parents[2]
#: How arithmatex leaves equations: \( inline \) and \[ display \].
EQUATION = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', flags=re.DOTALL)
#: Letters of every equation are paths of its own, so that no two share names.
ziafont.config.svg2 = False


def on_files(files, config):
    """Adds each executed notebook, with its pictures, below examples/."""
    for path in sorted((ROOT / "examples").glob("*.ipynb")):
        notebook = nbformat.read(path, as_version=4)
        name = {"unique_key": path.stem, "output_files_dir": path.stem}
        text, resources = MarkdownExporter().from_notebook_node(notebook, name)
        # Tables as those of the other pages.
        text = re.sub(r"<style scoped>.*?</style>", "", text, flags=re.DOTALL)
        text = re.sub(r'<table border="1" class="dataframe">', "<table>", text)
        files.append(File.generated(config, f"examples/{path.stem}.md", content=text))
        for picture, content in resources["outputs"].items():
            files.append(File.generated(config, f"examples/{picture}", content=content))
    return files


def title(page):
    return re.search(r"^# (.*)$", (ROOT / "docs" / page).read_text(), flags=re.MULTILINE).group(1)


def on_page_markdown(markdown, page, config, files):
    """Links say the title of a page, not its file; those that leave docs/ lead to a notebook's page, or name a file."""
    depth = "../" * page.file.src_uri.count("/")
    markdown = re.sub(r"\[(\w+\.md)\]\(", lambda found: f"[{title(found.group(1))}](", markdown)
    markdown = re.sub(
        r"\[examples/\w+\.ipynb\]\(\.\./examples/(\w+)\.ipynb\)", rf"[\1]({depth}examples/\1.md)", markdown
    )
    markdown = re.sub(r"\]\(\.\./examples/(\w+)\.ipynb\)", rf"]({depth}examples/\1.md)", markdown)
    return re.sub(r"\[([^\]]*)\]\(\.\./(?!examples/)[^)]*\)", r"\1", markdown)


def on_page_content(content, page, config, files):
    """Equations as SVG: no script and no font from elsewhere, and alike in every browser."""

    def formula(found):
        text = html.unescape(found.group(3)).strip()
        block = found.group(2) == "["
        drawn = ziamath.Latex(text, size=17 if block else 15.5, color="currentColor", inline=not block)
        label = f'class="equation" role="img" aria-label="{html.escape(text)}"'
        place = "" if block else f' style="vertical-align: {drawn.getyofst():.1f}px"'
        picture = drawn.svg().replace("<svg ", f"<svg {label}{place} ", 1)
        return f'<div class="equation">{picture}</div>' if block else picture

    return EQUATION.sub(formula, content)
