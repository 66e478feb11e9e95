"""The commands, and sets of them that share options."""

COMMANDS = (
    "render", "fit", "farm", "merge", "solve", "place", "studio", "check", "graph", "evaluate",
    "bench", "study", "doctor", "completion",
)  # fmt: skip
JOBS, MAKE, ANALYSE = "farm --jobs", "study make", "study analyse"
"""Forms of a command with options of their own."""

RUN = ("render", "farm")
SHOT = ("render", "fit", "farm")
ENCODED = ("render", "farm", "merge")
SOURCE = ("render", "fit", "farm", "merge", "solve", "place", "check")
PLACED = ("render", "fit", "farm", "place")
SEEN = (*PLACED, "solve")
SOLVED = ("render", "fit", "solve")
BAR = ("render", "fit", "farm", JOBS, "merge", "solve")
ANY = (*COMMANDS, JOBS)
