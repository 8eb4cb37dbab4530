"""`report.html` in a real browser: no error, no request, a picture in three dimensions that answers.

Needs Chromium (Debian: `chromium`) and a run folder, named by the environment variable MAMMOTWIN_RESULTS; skipped without.
"""

import base64
import html
import io
import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import matplotlib.image
import pytest

RESULTS = os.environ.get("MAMMOTWIN_RESULTS")
BROWSER = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
MEGABYTE = 1 << 20

#: Runs in the page after its own scripts; what it finds goes into the page as JSON.
PROBE = """
<script>
addEventListener("load", async () => {
  const found = { errors: window.seen };
  const wait = ms => new Promise(done => setTimeout(done, ms));
  try {
    const part = name => document.querySelector(`#viewer [data-part="${name}"]`);
    const canvas = part("canvas");
    const picture = (canvas = part("canvas")) => {
      const flat = document.createElement("canvas");
      [flat.width, flat.height] = [canvas.width, canvas.height];
      const context = flat.getContext("2d", { willReadFrequently: true });
      context.drawImage(canvas, 0, 0);
      const data = context.getImageData(0, 0, flat.width, flat.height).data;
      let drawn = 0, hash = 0;
      const colours = new Set();
      for (let n = 0; n < data.length; n += 4) {
        if (data[n + 3] > 0) { drawn++; colours.add(data[n] << 16 | data[n + 1] << 8 | data[n + 2]); }
        hash = (hash * 31 + data[n] + 3 * data[n + 1] + 7 * data[n + 2] + 11 * data[n + 3]) | 0;
      }
      return { drawn: drawn / (data.length / 4), colours: colours.size, hash };
    };
    const key = name => canvas.dispatchEvent(new KeyboardEvent("keydown", { key: name, cancelable: true }));
    const state = () => ({ ...picture(), label: part("label").textContent, aria: part("step").getAttribute("aria-valuetext") });
    await wait(300);
    found.first = state();
    part("step").value = 0;
    part("step").dispatchEvent(new Event("input"));
    await wait(200);
    found.moved = state();
    key(".");
    await wait(200);
    found.stepped = state();
    key("ArrowLeft");
    await wait(200);
    found.turned = state();
    found.quantities = [];
    part("step").value = part("step").max;
    part("step").dispatchEvent(new Event("input"));
    for (const option of part("quantity").options) {
      part("quantity").value = option.value;
      part("quantity").dispatchEvent(new Event("change"));
      await wait(150);
      found.quantities.push({ ...picture(), name: option.text, unit: part("unit").textContent, ticks: part("ticks").innerText });
    }
    found.scenes = [];
    for (const option of part("scene").options) {
      part("scene").value = option.value;
      part("scene").dispatchEvent(new Event("change"));
      await wait(200);
      found.scenes.push({ ...state(), name: option.text });
    }
    const box = canvas.getBoundingClientRect();
    canvas.dispatchEvent(new PointerEvent("pointermove", { clientX: box.left + box.width / 2, clientY: box.top + box.height / 2 }));
    found.tip = part("tip").hidden ? "" : part("tip").textContent;
    // What the pointer says and what is painted there, of the first pose.
    found.painted = [];
    const pose = [...part("scene").options].find(option => option.text.startsWith("Pose"));
    if (pose) {
      part("scene").value = pose.value;
      part("scene").dispatchEvent(new Event("change"));
      await wait(200);
      const flat = document.createElement("canvas");
      [flat.width, flat.height] = [canvas.width, canvas.height];
      const context = flat.getContext("2d", { willReadFrequently: true });
      context.drawImage(canvas, 0, 0);
      for (let u = 0.05; u < 1; u += 0.05) for (let v = 0.05; v < 1; v += 0.05) {
        canvas.dispatchEvent(new PointerEvent("pointermove", { clientX: box.left + box.width * u, clientY: box.top + box.height * v }));
        const [red, , blue, alpha] = context.getImageData(Math.round(canvas.width * u), Math.round(canvas.height * v), 1, 1).data;
        found.painted.push([part("tip").hidden ? "" : part("tip").textContent, red - blue, alpha]);
      }
    }
    const chart = document.querySelector("figure.chart svg"), figure = chart.closest("figure");
    chart.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight" }));
    found.chart = figure.querySelector(".tip").textContent;
    const film = document.querySelector('[data-part="window"]');
    if (film) {
      film.querySelector("input").value = 40;
      film.querySelector("input").dispatchEvent(new Event("input"));
      found.film = [film.closest("figure").querySelector(".film img").style.filter, film.querySelector("output").textContent];
    }
    const paper = () => getComputedStyle(document.documentElement).backgroundColor;
    found.light = paper();
    document.getElementById("theme").click();
    await wait(200);
    found.dark = paper();
    // Printed, it is on white, a copy of its own size, and afterwards as it was.
    dispatchEvent(new Event("beforeprint"));
    found.printed = { ...picture(part("print")), paper: paper(), wide: part("print").width / part("print").height };
    dispatchEvent(new Event("afterprint"));
    found.after = [paper(), part("print").width];
    found.width = [document.documentElement.scrollWidth, innerWidth];
    found.requests = performance.getEntriesByType("resource").map(entry => entry.name).filter(name => !name.startsWith("data:"));
    found.unnamed = [...document.querySelectorAll("button, select, input")].filter(item =>
      !item.textContent.trim() && !item.closest("label") && !item.getAttribute("aria-label")).length;
    found.images = [...document.images].filter(image => !image.alt || !image.complete || !image.naturalWidth).length;
  } catch (error) { found.errors.push(String(error.stack || error)); }
  const out = document.createElement("pre");
  out.id = "found";
  out.textContent = JSON.stringify(found);
  document.body.append(out);
});
</script>
"""
#: Runs before all else.
WATCH = """<script>
window.seen = [];
// Without a screen the browser makes frames when it likes.
window.requestAnimationFrame = work => setTimeout(work, 0);
addEventListener("error", event => seen.push(event.message));
addEventListener("unhandledrejection", event => seen.push(String(event.reason)));
addEventListener("securitypolicyviolation", event => seen.push(`refused: ${event.blockedURI}`));
for (const word of ["error", "warn"]) { const old = console[word]; console[word] = (...all) => { seen.push(all.join(" ")); old(...all); }; }
</script>"""


@pytest.fixture(scope="module")
def report():
    path = Path(RESULTS or "").parent / "report.html"
    if not RESULTS or not path.exists():
        pytest.skip("no report: set MAMMOTWIN_RESULTS to results.h5 of a run folder")
    return path


@pytest.fixture(scope="module", params=[(1200, 900), (420, 900)], ids=["wide", "narrow"])
def found(request, report, tmp_path_factory):
    if not BROWSER:
        pytest.skip("no Chromium: apt-get install chromium")
    folder = tmp_path_factory.mktemp("browser")
    text = report.read_text()
    policy = text.index(">", text.index("Content-Security-Policy")) + 1
    text = text[:policy] + WATCH + text[policy:].replace("</body>", PROBE + "</body>", 1)
    page = folder / "probed report.html"
    page.write_text(text)
    width, height = request.param
    command = [BROWSER, "--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    command += ["--enable-logging=stderr", f"--user-data-dir={folder / 'profile'}", f"--window-size={width},{height}"]
    command += ["--virtual-time-budget=60000", "--dump-dom", page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=180, check=True)
    spoken = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, flags=re.DOTALL)
    assert spoken, done.stderr[-2000:]
    answer = json.loads(html.unescape(spoken.group(1)))
    answer["console"] = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    return answer


def test_the_page_is_small_and_names_no_other(report):
    text = report.read_text()
    assert report.stat().st_size < 15 * MEGABYTE
    assert not re.search(r"""(?:src|href)\s*=\s*["'](?!data:|#)""", text)
    assert "url(" not in text and "@import" not in text


def test_no_error_and_no_request(found):
    assert found["errors"] == [] and found["console"] == []
    assert found["requests"] == []
    assert found["images"] == 0 and found["unnamed"] == 0, "every picture and control has a name"


def test_the_breast_is_drawn_and_the_slider_moves_it(found):
    first, moved, stepped, turned = (found[name] for name in ("first", "moved", "stepped", "turned"))
    for state in (first, moved, stepped, turned):
        assert state["drawn"] > 0.05 and state["colours"] > 20, "not blank, not flat"
        assert state["aria"] == state["label"]
    assert first["label"] != moved["label"] and first["hash"] != moved["hash"]
    assert moved["label"].startswith("1 of ") and stepped["label"].startswith("2 of ")
    assert stepped["hash"] != turned["hash"] and stepped["label"] == turned["label"], "arrow keys turn"


def test_quantities_and_poses_have_pictures_and_scales_with_units(found):
    assert len({quantity["hash"] for quantity in found["quantities"]}) == len(found["quantities"]) >= 2
    for quantity in found["quantities"]:
        unit = re.search(r"\((\w+)\)", quantity["name"]).group(1)
        assert f"({unit})" in quantity["unit"] and len(quantity["ticks"].split()) == 5
    assert any("distance" in scene["label"] for scene in found["scenes"])
    assert all(scene["drawn"] > 0.05 for scene in found["scenes"])


def test_what_the_pointer_says_is_what_is_painted(found):
    """Red outside of the measured skin, blue inside, grey where nothing is compared, nothing beside the body."""
    if not found["painted"]:
        pytest.skip("no pose was compared")
    kinds, wrong = set(), 0
    for text, red_over_blue, alpha in found["painted"]:
        said = re.match(r"(−?[\d.]+) mm at", text)
        value = float(said.group(1).replace("−", "-")) if said else None
        if not text:
            kind, right = "none", alpha == 0
        elif value is None:
            kind, right = "grey", alpha == 255 and 0 < red_over_blue < 12
        elif value > 0.5:
            kind, right = "red", red_over_blue > 8
        elif value < -0.5:
            kind, right = "blue", red_over_blue < 0
        else:
            continue
        kinds.add(kind)
        wrong += not right
    assert kinds == {"none", "grey", "red", "blue"}
    # A pixel at a silhouette, or at the rim of what is compared, may fall on the other side.
    assert wrong <= 0.02 * len(found["painted"])


def test_values_are_said(found):
    assert re.search(r" at \(.*\) mm$", found["tip"]), found["tip"]
    assert re.match(r".+: .+ .+; .+", found["chart"]), found["chart"]
    if "film" in found:
        assert found["film"] == ["brightness(1) contrast(2.5)", "40 %, 50 %"]


def test_themes_paper_and_widths(found):
    assert found["light"] != found["dark"]
    printed = found["printed"]
    assert printed["drawn"] > 0.05 and printed["colours"] > 20 and printed["paper"] == found["light"]
    assert printed["wide"] == pytest.approx(640 / 300, rel=0.02)
    assert found["after"] == [found["dark"], 1]
    content, window = found["width"]
    assert content <= window, "no sideways scrolling"


def test_pictures_of_surfaces_have_no_ground_of_their_own(report):
    """Their corners are transparent, so that they stand on the paper of either theme."""
    pictures = re.findall(r'<div class="view"><img src="data:image/png;base64,([^"]+)"', report.read_text())
    assert len(pictures) >= 6
    for picture in pictures:
        pixels = matplotlib.image.imread(io.BytesIO(base64.b64decode(picture)), format="png")
        assert pixels.shape[2] == 4 and pixels[0, 0, 3] == 0 and pixels[..., 3].max() == 1
