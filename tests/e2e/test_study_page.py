"""The page of experiments in a real browser: layout, contrast, links and data."""

import csv
import html
import json
import re
import shutil
import subprocess

import pytest

from trials.report.figure import save_figure, tidy
from trials.studies.experiments.base import Record, Table, Verdict
from trials.studies.experiments.page import write_html_page

BROWSER = shutil.which("chromium") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium")
SCHEMES = {"dark": "0", "light": "1"}
PHONE_PX, DESK_PX = 390, 1280
ATTEMPTS = 8
"""The browser prints the page when its virtual time is up, at times before the probe answers."""
MIN_CONTRAST = 4.5
"""Of text against what is behind it (WCAG 2.1, 1.4.3)."""

PROBE = """
<script type="module">
const rgb = colour => colour.match(/[\\d.]+/g).map(Number);
const luminance = ([r, g, b]) => [r, g, b].map(x => x / 255)
  .map(x => x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4)
  .reduce((sum, x, k) => sum + x * [0.2126, 0.7152, 0.0722][k], 0);
const behind = node => {
  const colour = rgb(getComputedStyle(node).backgroundColor);
  return colour[3] === 0 ? behind(node.parentElement) : colour;
};
const contrast = node => {
  const [a, b] = [rgb(getComputedStyle(node).color), behind(node)].map(luminance);
  return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
};
const says = node => [...node.childNodes].some(x => x.nodeType === 3 && x.data.trim());
const texts = [...document.querySelectorAll("main *")].filter(says);
const pictures = [...document.querySelectorAll("img")];
await Promise.all(pictures.map(image => image.decode()));
const found = {
  width: innerWidth,
  page: document.documentElement.scrollWidth,
  scheme: matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light",
  contrast: Object.fromEntries(texts.map(x => [x.tagName + "." + x.className, contrast(x)])),
  pictures: pictures.map(x => [x.naturalWidth, x.clientWidth, x.parentElement.clientWidth]),
  tables: [...document.querySelectorAll(".scroll")].map(x => [x.clientWidth, x.scrollWidth]),
  first: getComputedStyle(document.querySelector(".results td")).position,
  broken: [...document.querySelectorAll("main a[href^='#']")]
    .filter(x => !document.getElementById(x.hash.slice(1))).length,
  csv: await Promise.all([...document.querySelectorAll("a[download]")]
    .map(async x => [x.download, await (await fetch(x.href)).text()])),
  code: [...document.querySelectorAll("code")].map(x => x.textContent),
};
parent.postMessage(JSON.stringify(found), "*");
</script>
"""

FRAME = """<!doctype html>
<meta name="color-scheme" content="light dark">
<script>
addEventListener("message", event => {{
  const answer = document.createElement("pre");
  answer.id = "found";
  answer.textContent = event.data;
  document.body.append(answer);
}});
</script>
<iframe src="{page}" style="width: {width_px}px; height: 900px; border: 0"></iframe>
"""
"""A window as narrow as a phone: the browser's own are 500 px wide or more."""


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A page with a wide table, every verdict, and a probe that measures it."""
    folder = tmp_path_factory.mktemp("study")
    data = folder / "data.csv"
    data.write_text("frame,drift over 1 m %\n0,0.5\n1,0.25\n", encoding="utf-8")
    figure = folder / "figure.png"

    def draw(canvas):
        panel = canvas.subplots()
        panel.plot([0, 1], [0.5, 0.25])
        tidy(panel, "frame", "drift over 1 m, %")

    save_figure(figure, (7.0, 3.0), draw)
    columns = tuple(f"a heading of some length, number {k}" for k in range(12))
    table = Table(columns, (("a_scene", *["0.123 (0.100 to 0.150)"] * 11),))
    records = [
        Record(
            id=f"E{k}",
            title="A title",
            claim="A claim of such a length that it needs more than one line on a phone.",
            source="section 1",
            setup="Run `driftyard run` <twice>.",
            verdict=verdict,
            sentence="A sentence.",
            table=table,
            caption="What is shown.",
            figure=figure.name,
            data=(data.name,),
            seeds=(0, 1),
            distance_m=4.0,
        )
        for k, verdict in enumerate(Verdict)
    ]
    page = folder / "study.html"
    write_html_page(records, folder, page)
    text = page.read_text(encoding="utf-8").replace("</body>", PROBE + "</body>")
    page.write_text(text, encoding="utf-8")
    return page, data


def probe(page, width_px, scheme):
    """Return what the probe finds in a window of a width, in light or dark."""
    words = (
        f"--user-data-dir={page.parent / 'profile'}",
        "--window-size=1400,1000",
        f"--blink-settings=preferredColorScheme={SCHEMES[scheme]}",
        "--virtual-time-budget=10000",
        "--dump-dom",
    )
    frame = page.with_name("frame.html")
    frame.write_text(FRAME.format(page=page.name, width_px=width_px), encoding="utf-8")
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", *words, frame.as_uri()]
    for _ in range(ATTEMPTS):
        shown = subprocess.run(command, capture_output=True, timeout=120, check=True, text=True)
        if found := re.search(r'<pre id="found">(.*)</pre>', shown.stdout, re.DOTALL):
            return json.loads(html.unescape(found[1]))
    raise AssertionError(f"the probe never answered in {ATTEMPTS} attempts")


@pytest.mark.parametrize("scheme", SCHEMES)
def test_phone_page_scrolls_tables_and_figures_only(study, scheme):
    found = probe(study[0], PHONE_PX, scheme)
    assert (found["width"], found["scheme"]) == (PHONE_PX, scheme)
    assert found["page"] <= PHONE_PX
    summary, *results = found["tables"]
    assert summary[0] == summary[1]
    assert all(shown < whole for shown, whole in results)
    assert found["first"] == "sticky"
    for natural, shown, window in found["pictures"]:
        assert natural > 0
        assert shown >= 640 > window  # its letters are as large as on a desk
    assert {k: x for k, x in found["contrast"].items() if x < MIN_CONTRAST} == {}


def test_desktop_page_fits_figures_and_links_data(study):
    page, data = study
    found = probe(page, DESK_PX, "light")
    assert found["page"] <= found["width"]
    assert all(shown <= window for _, shown, window in found["pictures"])
    assert found["broken"] == 0
    assert found["csv"] == [["data.csv", data.read_text()]] * 4
    assert len(list(csv.reader(found["csv"][0][1].splitlines()))) == 3
    assert found["code"] == ["driftyard experiment all", *["driftyard run"] * 4]
    assert {k: x for k, x in found["contrast"].items() if x < MIN_CONTRAST} == {}
