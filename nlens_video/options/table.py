"""Every option of every command: a new option is one row of the modules of rows.

Parsers (`options.parser_of`), settings (`to_settings`), the parameters of a `Compositor` and the
files that a command reads and writes (`cli.output_files`) are derived from these rows.
"""

from __future__ import annotations

from nlens_video.options.command_rows import COMMAND_OPTIONS
from nlens_video.options.object_rows import OBJECT_OPTIONS
from nlens_video.options.option import Option
from nlens_video.options.run_rows import RUN_OPTIONS

OPTIONS: dict[str, tuple[Option, ...]] = {**COMMAND_OPTIONS, **OBJECT_OPTIONS, **RUN_OPTIONS}
"""By the title of their group in the help."""
ROWS = tuple(option for group in OPTIONS.values() for option in group)
PARAMETERS = {option.attribute: option for option in ROWS if option.parameter}
"""Options that a `Compositor` takes, by the attribute of the parsed arguments."""
