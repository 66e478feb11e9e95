"""The paper's user study, ready to run: its page, and the analysis of its answers."""
