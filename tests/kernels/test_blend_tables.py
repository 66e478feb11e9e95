from nlens_video.kernels import blend, blend_samples


def test_kernels_read_the_tables_as_they_are_made():
    made = (blend_samples.STEPS_BITS, blend_samples.FIRST_OCTAVE)
    assert (blend.STEPS_BITS, blend.FIRST_OCTAVE) == made
