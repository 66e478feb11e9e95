"""What hands do on the studio's page, and what is seen of it then."""

import tomllib

import cv2
import numpy as np
from support.studio import WAIT_MS

CORNER_PX = 5  # more than the radius of the picture's corners


def at_rest(page, act, kind="rest"):
    """Do something, and wait for the picture at rest, or of another kind, that follows."""
    before = page.evaluate("document.body.dataset.drawn")
    act()
    page.wait_for_selector(f"body[data-kind={kind}]:not([data-drawn='{before}'])", timeout=WAIT_MS)


def seen(page):
    """The picture as the page shows it, without what is drawn over it."""
    page.locator("#show-guides").uncheck()
    found = canvas(page, "#picture")
    page.locator("#show-guides").check()
    return found


def canvas(page, name):
    """A picture of the page, black at its rounded corners: how they are smoothed varies."""
    data = page.locator(name).screenshot()
    found = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    for rows in (slice(None, CORNER_PX), slice(-CORNER_PX, None)):
        for columns in (slice(None, CORNER_PX), slice(-CORNER_PX, None)):
            found[rows, columns] = 0
    return found


def plate_seen(page):
    view(page, "Plate")
    plate = seen(page)
    at_rest(page, lambda: view(page, "Final"))
    return plate


def view(page, name):
    page.locator(".views").get_by_text(name, exact=True).click()


def saved(page, shot):
    page.locator("#save").click()
    page.get_by_text("· saved", exact=True).wait_for()
    return tomllib.loads(shot.read_text())


def drag(page, handle, across, down):
    box, frame = handle.bounding_box(), page.locator("#picture").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    for part in (0.3, 0.7, 1.0):
        page.mouse.move(x + part * across * frame["width"], y + part * down * frame["height"])
    page.mouse.up()
