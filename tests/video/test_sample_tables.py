from nlens_video.video.pixels import blend, sample_tables


def test_sample_tables_have_the_layout_that_kernels_read():
    made = (sample_tables.STEPS_BITS, sample_tables.FIRST_OCTAVE)
    assert (blend.STEPS_BITS, blend.FIRST_OCTAVE) == made
