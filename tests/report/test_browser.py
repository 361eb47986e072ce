"""Every kind of page in headless Chromium, on a desk and on a phone, light and dark: nothing is clipped, wider than the
screen or unreadable, and the first answer is above the fold."""

import html
import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from click.testing import CliRunner
from fleet_cases import two_joint_arms
from report_runs import discovered, evolved

from gpmodel.cli.main import main
from gpmodel.report.write import write_report

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
BROWSER = next((found for name in NAMES if (found := shutil.which(name))), None)
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(BROWSER is None, reason=f"none of {', '.join(NAMES)} is installed: pages are not looked at"),
]
SCREENS = ((1366, 768), (390, 844))
SCHEMES = {"dark": 0, "light": 1}
"""Values of Chromium's setting for the preferred colour scheme."""
MOST_SIDES = {"report": 4, "certificate": 2, "verify": 2}
"""Sides of A4 that a page prints on, by its name."""
LOOK = r"""
function look(frame) {
  const w = frame.contentWindow, d = frame.contentDocument, W = w.innerWidth, H = w.innerHeight, out = [];
  const style = e => w.getComputedStyle(e), box = e => e.getBoundingClientRect();
  const say = (what, e) => out.push(`${what}: ${e.tagName} ${(e.textContent || "").trim().slice(0, 40)}`);
  const scrolls = e => e && e !== d.body && (/auto|scroll/.test(style(e).overflowX) || scrolls(e.parentElement));
  const behind = e => !e ? "rgb(255, 255, 255)"
    : /, 0\)/.test(style(e).backgroundColor) ? behind(e.parentElement) : style(e).backgroundColor;
  const linear = v => v <= .04045 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4;
  const light = c => c.match(/[\d.]+/g).slice(0, 3)
    .reduce((sum, v, i) => sum + linear(v / 255) * [.2126, .7152, .0722][i], 0);
  if (d.documentElement.scrollWidth > W) out.push(`page of ${d.documentElement.scrollWidth} on ${W}`);
  for (const e of d.body.querySelectorAll("*")) {
    const s = style(e), r = box(e);
    if (!r.width || !r.height || e.closest(".hidden, .skip, script")) continue;
    if (e.tagName === "text" && e.closest(".chart")) {
      const v = box(e.ownerSVGElement), scale = v.width / e.ownerSVGElement.viewBox.baseVal.width;
      const size = parseFloat(s.fontSize) * scale;
      const beyond = Math.max(v.left - r.left, r.right - v.right, v.top - r.top, r.bottom - v.bottom);
      if (beyond > size / 2) say(`cut by ${beyond.toFixed(1)} px`, e);
      if (size < 7) say(`${size.toFixed(1)} px`, e);
    }
    if (e.closest("svg, canvas, #view")) continue;
    if (!scrolls(e.parentElement) && (r.right > W + 1 || r.left < -1)) say("beyond the screen", e);
    if (/hidden|clip/.test(s.overflowX) && e.scrollWidth > e.clientWidth + 1) say("clipped", e);
    if ([...e.childNodes].some(n => n.nodeType === 3 && n.data.trim())) {
      const [a, b] = [light(s.color), light(behind(e))].sort((p, q) => q - p), contrast = (a + .05) / (b + .05);
      if (contrast < 4.5) say(`contrast ${contrast.toFixed(1)}`, e);
    }
  }
  for (const answer of d.querySelectorAll("h1, header .tiles, header .behind, header + main > *:first-child, canvas"))
    if (box(answer).top > .9 * H) say("below the fold", answer);
  const title = d.querySelector("h1"), text = d.createTreeWalker(title, 4), range = d.createRange();
  if (box(title).bottom > .45 * H) say(`title of ${Math.round(box(title).height)} px`, title);
  const number = /[\d.]+\s(mm|%|[mµn]?rad)|[\d.]+\s[→±]\s[\d.]+/g;
  while (text.nextNode()) for (const m of text.currentNode.data.matchAll(number)) {
    range.setStart(text.currentNode, m.index);
    range.setEnd(text.currentNode, m.index + m[0].length);
    if (new Set([...range.getClientRects()].map(r => Math.round(r.top))).size > 1) out.push(`broken: ${m[0]}`);
  }
  return out;
}
onload = () => setTimeout(() => {
  const said = {};
  for (const frame of document.querySelectorAll("iframe")) said[frame.title] = look(frame);
  document.querySelector("pre").textContent = JSON.stringify(said);
}, 1000);
"""


@pytest.fixture(scope="session")
def pages(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Return a small case of every kind of page."""
    root = tmp_path_factory.mktemp("pages")
    write_report(discovered(), root / "discover")
    write_report(evolved(), root / "evolve")
    machines = two_joint_arms(root / "machines", 4)
    arm, (head, *rows) = machines / "arm.toml", (machines / "A-1.csv").read_text().splitlines(keepends=True)
    for name, some in (("t.csv", rows[:20]), ("again.csv", rows[20:])):
        (root / name).write_text("".join((head, *some)))
    calibrate = ["calibrate", root / "t.csv", "--mechanism", arm, "--out"]
    named, verify = root / "named", root / "verify"
    for words in (
        [*calibrate, root / "plain"], [*calibrate, named, "--effect", "gear_harmonic J2"],
        ["verify", named / "model.json", root / "again.csv", "--tolerance", "1mm", "--out", verify],
        ["certificate", named], ["certificate", verify], ["explain", named, 1, "--out", named],
        ["compare", root / "plain", named, "--out", root / "compare"],
        ["fleet", machines, "--effect", "gear_harmonic J2", "--workers", 1, "--out", root / "fleet"],
    ):  # fmt: skip
        done = CliRunner().invoke(main, [str(word) for word in words], catch_exceptions=False)
        assert done.exit_code == 0, done.output
    further = [root / name / "explore.html" for name in ("evolve", "plain", "named")]
    kinds = sorted(page for page in root.rglob("*.html") if "machines" not in page.parts and page not in further)
    assert {page.stem for page in kinds} == {
        "report", "explore", "certificate", "verify", "finding_1", "compare", "fleet"
    }  # fmt: skip
    return kinds


def browse(page: Path, *options: str) -> str:
    """Return what headless Chromium prints of a page."""
    assert BROWSER is not None
    command = [BROWSER, "--headless", "--no-sandbox", "--allow-file-access-from-files", *options, page.as_uri()]
    return subprocess.run(command, check=True, capture_output=True, text=True, timeout=240).stdout


def looked_at(pages: list[Path], scheme: str) -> dict[str, list[str]]:
    """Return what is wrong with each page on each screen, by its path and the width.

    Each is in a frame of the size of the screen, since a window of Chromium has 500 pixels at least.
    """
    folder = pages[0].parents[1]
    frames = (
        f'<iframe title="{page.relative_to(folder).as_posix()} {width}" src="{page.as_uri()}" width={width} '
        f'height={height} style="border:0"></iframe>'
        for page in pages
        for width, height in SCREENS
    )
    wrapper = folder / "all.htm"
    wrapper.write_text(
        '<!doctype html><meta name="color-scheme" content="light dark"><body>'
        f"{''.join(frames)}<pre></pre><script>{LOOK}</script>",
        encoding="utf-8",
    )
    options = ("--virtual-time-budget=20000", f"--blink-settings=preferredColorScheme={SCHEMES[scheme]}")
    said = re.search(r"<pre>(.+?)</pre>", browse(wrapper, *options, "--dump-dom"), re.DOTALL)
    assert said is not None
    return dict(json.loads(html.unescape(said.group(1))))


@pytest.mark.parametrize("scheme", SCHEMES)
def test_nothing_is_clipped_or_wider_than_the_screen_and_the_answer_is_above_the_fold(
    pages: list[Path], scheme: str
) -> None:
    found = looked_at(pages, scheme)
    assert len(found) == len(pages) * len(SCREENS)
    assert {page: wrong for page, wrong in found.items() if wrong} == {}


def test_a_page_that_is_too_wide_pale_and_late_is_seen(tmp_path: Path) -> None:
    folder = tmp_path / "bad"
    folder.mkdir()
    bad = folder / "bad.html"
    bad.write_text(
        '<!doctype html><body><div style="height:900px;width:2000px">wide</div><h1>late</h1>'
        '<p style="color:#ccc">pale</p><p style="width:40px;overflow:hidden;white-space:nowrap">cut off here</p>'
    )
    found = " ".join(looked_at([bad], "light")["bad/bad.html 1366"])
    assert all(
        said in found for said in ("page of 2", "beyond the screen: DIV", "below the fold", "contrast", "clipped")
    )


def test_pages_print_on_few_sides(pages: list[Path], tmp_path: Path) -> None:
    sides = {}
    for page in (p for p in pages if p.stem in MOST_SIDES):
        browse(page, "--no-pdf-header-footer", f"--print-to-pdf={tmp_path / 'page.pdf'}")
        sides[page] = len(re.findall(rb"/Type\s*/Page\b", (tmp_path / "page.pdf").read_bytes()))
    assert {page: count for page, count in sides.items() if not 1 <= count <= MOST_SIDES[page.stem]} == {}
