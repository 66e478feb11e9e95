"""Past one machine: chunks of a shot rendered anywhere, merged once."""
