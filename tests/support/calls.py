"""How many functions a piece of work calls, which no other load of the machine changes."""

import sys


def calls_of(work):
    """Functions that some work calls on this thread, those of compiled modules included."""
    count = 0

    def look(frame, event, argument):
        nonlocal count
        count += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(look)
    try:
        work()
    finally:
        sys.setprofile(before)
    return count
