"""The options of every command and of the compositor: definitions, parser, settings."""
