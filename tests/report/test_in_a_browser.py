"""The report in a real browser: on a phone, by keyboard, with the network cut off."""

import pytest
from support import browser, shots

from nlens_video.cli.main import main

pytestmark = pytest.mark.needs_chromium

LOOK = """<!doctype html><body><iframe id="page" src="report/index.html"
style="width:WIDTHpx;height:900px;border:0"></iframe><script>
addEventListener("load", () => {
  const page = document.getElementById("page").contentDocument;
  const view = page.defaultView;
  const root = page.documentElement;
  const slider = page.querySelector(".compare input");
  const above = page.querySelector(".compare");
  const split = () => view.getComputedStyle(above).getPropertyValue("--split");
  slider.focus();
  const seen = {
    overflow: root.scrollWidth - root.clientWidth,
    wide: [...page.querySelectorAll("img, svg, table, p")]
      .filter(one => one.getBoundingClientRect().right > root.clientWidth + 1)
      .filter(one => !one.closest("[tabindex], .scroll"))
      .map(one => one.outerHTML.slice(0, 80)),
    broken: [...page.images].filter(one => !one.naturalWidth).length,
    text: Math.min(...[...page.querySelectorAll("p, td, li")]
      .map(one => parseFloat(view.getComputedStyle(one).fontSize))),
    focused: page.activeElement === slider,
    outline: view.getComputedStyle(slider).outlineStyle,
    splits: [0, 30, 100].map(value => {
      slider.value = value;
      slider.dispatchEvent(new view.Event("input", { bubbles: true }));
      return [split(), slider.getAttribute("aria-valuetext")];
    }),
    reachable: [...page.querySelectorAll("a, button, input, summary, [tabindex]")]
      .every(one => one.tabIndex >= 0),
  };
  document.body.setAttribute("data-seen", JSON.stringify(seen));
});
</script></body>"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A report of a real run."""
    folder = tmp_path_factory.mktemp("browser")
    plate = shots.write_video(folder / "in.mp4", frames=8)
    glb = shots.cube_glb(folder / "anim.glb", end=(0.2, 0.0, -2.0))
    words = [plate, glb, folder / "out.mp4", "--report", folder / "report", "-q"]
    assert main([*map(str, words)]) == 0
    return folder


@pytest.fixture(scope="module")
def seen(folder):
    """What the browser finds at a width [px]."""

    def look(width):
        harness = folder / f"look{width}.html"
        harness.write_text(LOOK.replace("WIDTH", str(width)))
        return browser.seen(harness)

    return {width: look(width) for width in (360, 1200)}


@pytest.mark.slow
@pytest.mark.needs_gl
@pytest.mark.parametrize("width", [360, 1200])
def test_report_fits_the_window_and_loads_all_pictures(seen, width):
    page = seen[width]
    assert page["overflow"] <= 0 and page["wide"] == []
    assert page["broken"] == 0
    assert page["text"] >= 12


@pytest.mark.slow
@pytest.mark.needs_gl
def test_comparison_slider_is_focusable_and_announces_its_position(seen):
    page = seen[360]
    assert page["focused"] and page["reachable"]
    assert page["outline"] != "none"
    assert page["splits"] == [
        ["0%", "0 % plate, 100 % composite"],
        ["30%", "30 % plate, 70 % composite"],
        ["100%", "100 % plate, 0 % composite"],
    ]
