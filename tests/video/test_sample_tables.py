from nlens_video.video.pixels import blend, sample_tables


def test_kernels_read_the_tables_as_they_are_made():
    made = (sample_tables.STEPS_BITS, sample_tables.FIRST_OCTAVE)
    assert (blend.STEPS_BITS, blend.FIRST_OCTAVE) == made
