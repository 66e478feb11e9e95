"""The studio: a page on this machine that edits a shot file and shows what it makes."""
