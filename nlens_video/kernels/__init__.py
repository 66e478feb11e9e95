"""Hot loops. Beside each fast one stands a slow, obvious reference (`*_ref.py`) that defines it.

A blurred object is its sharp layer scattered: every pixel spreads over the disc of confusion that
the lens makes of it (`scatter`), with weights that are exact areas (`disc`). The pixels around the
object take part as a transparent background with the object's own CoC (`extend`).
"""

from nlens_video.kernels import cache_folder

cache_folder.settle()
