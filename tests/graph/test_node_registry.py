"""Nodes are imported with the registry."""

import subprocess
import sys

PROBE = """
import sys
from nlens_video.graph.pipeline_file import load_pipeline, shipped_pipelines
before = set(sys.modules)
for name in shipped_pipelines():
    load_pipeline(name)
print(*(name for name in set(sys.modules) - before if name.startswith("nlens_video")))
"""


def test_a_pipeline_imports_no_node_of_its_own():
    # inside GStreamer's threads nothing can be imported from disk
    found = subprocess.run(
        [sys.executable, "-c", PROBE], capture_output=True, text=True, check=True
    )
    assert found.stdout.split() == []
