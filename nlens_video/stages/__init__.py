"""The paper's four steps, `f_*`, `p_*`, `r_*` and `l_*`, and the composite, as plain callables.

plate picture --F--> CoC map ----------+
                                       R--> LensFit      (once, on the first frame in view)
object, camera, ground --P--> footprint+

LensFit, object depth --> object CoC --L--> blurred layer --over--> plate     (each frame)
"""
