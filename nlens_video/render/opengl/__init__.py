"""The renderer on OpenGL by pyrender and EGL, with shaders of its own."""
