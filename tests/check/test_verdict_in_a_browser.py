"""The page of a check in a real browser: on a phone, on a desk, on paper."""

import pytest
from support.browser import chromium, seen

from nlens_video.check.verdict import Verdict, at, write_page

pytestmark = pytest.mark.needs_chromium

LONG = (
    "96x64 px at 16,400 differ by up to 118.2 of 255 levels (tolerance 7.4) away from the object; "
    "if that is another object, give --max-objects 2 or more"
)
LOOK = """<!doctype html><body><iframe id="page" src="check/index.html"
style="width:WIDTHpx;height:900px;border:0"></iframe><script>
addEventListener("load", () => {
  const page = document.getElementById("page").contentDocument;
  const root = page.documentElement;
  const cells = [...page.querySelectorAll("tbody td")];
  document.body.setAttribute("data-seen", JSON.stringify({
    overflow: root.scrollWidth - root.clientWidth,
    found: Math.min(...cells.map(one => one.getBoundingClientRect().width)),
    broken: [...page.querySelectorAll("code")]
      .filter(one => one.getClientRects().length > 1).length,
  }));
});
</script></body>"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("browser")
    verdict = Verdict(
        result="out.mp4", plate="in.mp4", frames=(12, 12), object_frames=12, measures={},
        findings=(at("plate", (0, 11), 118.2, LONG),), notes=(),
    )  # fmt: skip
    write_page(folder / "check", verdict, [])
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(("width", "least"), [(360, 300), (400, 340), (800, 400), (1400, 700)])
def test_findings_table_fits_at_every_window_width(folder, width, least):
    harness = folder / f"look{width}.html"
    harness.write_text(LOOK.replace("WIDTH", str(width)))
    page = seen(harness, "--window-size=1500,1000")
    assert page["overflow"] <= 0 and page["broken"] == 0
    assert page["found"] >= least


@pytest.mark.slow
def test_page_can_be_printed(folder):
    target = folder / "check.pdf"
    chromium(folder, f"--print-to-pdf={target}", (folder / "check" / "index.html").as_uri())
    assert target.read_bytes().startswith(b"%PDF")
