"""Moving foreground of a shot: background subtraction, multi-target tracking, mattes, shadows.

A target is whatever moves in the plate, such as a person who walks by. The object is the one that
is inserted. Targets are detected and tracked at low resolution (`background.LOWRES_WIDTH`).

1. `reference_view` with `rotation_view`, `parallax_view` and `background_depth`: frames are warped
   into one view, in which the background is at rest.
2. `background` with `frame_sampler` and `survey`: background model by the temporal median.
3. `detection`: foreground mask, blobs, detections.
4. `tracker` with `track`, `association`, `appearance` and `mutual_occlusion`: tracks of the targets
   through merged blobs, and their depth order with the object.
5. `matte`: soft matte of the targets. `received_shadow`: their shadow on the object.

`graph.moving_foreground` runs 1 to 4 before rendering, `graph.foreground_matte` 5 on each frame.
"""
