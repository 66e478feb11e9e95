"""The pictures that the documents show of the studio: made here again, and compared."""

import pytest
from support.folders import ROOT
from support.studio_pictures import blocks, difference, draw

pytestmark = [pytest.mark.slow, pytest.mark.needs_chromium]
MOST = 0.025
"""Of the blocks: none differs from run to run, 2 % with letters of another font; a line more in the
panel moves what is below it, which is 9 %."""


def test_pictures_of_the_documents_show_the_page_as_it_is(browser, tmp_path):
    for made in draw(browser, tmp_path):
        assert blocks(made).std() > 40, made.name
        shown = ROOT / "docs" / made.name
        apart = difference(made, shown)
        assert apart <= MOST, f"{shown}: {apart:.1%} differs; python docs/make_studio.py"
