"""What the files of pictures say of their colour beyond what FFmpeg reads of them."""
