"""The studio's page as axe-core judges it: at two widths, dark and light, in each of its views."""

import itertools

import pytest
from support.browser import NODE_PACKAGES
from support.studio import shown
from support.studio_page import at_rest, view

pytestmark = [pytest.mark.slow, pytest.mark.needs_chromium, pytest.mark.needs_node_packages]
GRAVE = {"serious", "critical"}


def violations(page):
    """Rules that the page breaks, with their impact and the elements."""
    page.evaluate((NODE_PACKAGES / "axe-core" / "axe.min.js").read_text())
    found = page.evaluate("axe.run(document, {resultTypes: ['violations']})")["violations"]
    return [(one["impact"], one["id"], [node["html"] for node in one["nodes"]]) for one in found]


def test_no_serious_violation_at_any_width_dark_or_light(browser, studio):
    studio.reset(lens={})
    with shown(browser, studio.server) as page:
        page.locator("#sun").check()  # its rows are shown then
        page.locator("#compare").select_option("wipe plate")
        at_rest(page, lambda: view(page, "Focus"), "focus")
        for scheme, width in itertools.product(("light", "dark"), (1280, 400)):
            page.emulate_media(color_scheme=scheme)
            page.set_viewport_size({"width": width, "height": 900})
            for name in ("Final", "Sharp", "Plate", "Focus"):
                view(page, name)
                found = violations(page)
                assert not [one for one in found if one[0] in GRAVE], (name, scheme, width)


def test_axe_finds_what_is_wrong(page):
    page.evaluate("document.querySelector('#shadow').closest('label').replaceWith("
                  "document.querySelector('#shadow'))")  # fmt: skip
    page.evaluate("document.querySelector('#path').style.color = '#ccc'")
    assert {"select-name", "color-contrast"} <= {name for _, name, _ in violations(page)}
