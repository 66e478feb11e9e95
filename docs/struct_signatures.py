"""Signatures of structs on the site, an extension of griffe, which knows those of dataclasses."""

from __future__ import annotations

from typing import Any

import griffe

_BASE = "msgspec.Struct"


class StructSignatures(griffe.Extension):
    """Gives each `msgspec.Struct` the constructor that its fields make."""

    def on_class_members(self, *, cls: griffe.Class, **kwargs: Any) -> None:  # noqa: ANN401 - as griffe calls it
        """Add `__init__` to a struct; called by griffe once it has read the class."""
        if not any(
            isinstance(one, griffe.Expr) and one.canonical_path == _BASE for one in cls.bases
        ):
            return
        kind = griffe.ParameterKind.positional_or_keyword
        if str(cls.keywords.get("kw_only")) == "True":
            kind = griffe.ParameterKind.keyword_only
        fields = [
            griffe.Parameter(one.name, annotation=one.annotation, kind=kind, default=one.value)
            for one in cls.attributes.values()
            if one.annotation is not None and "property" not in one.labels
        ]
        first = griffe.Parameter("self", kind=griffe.ParameterKind.positional_or_keyword)
        init = griffe.Function(
            "__init__", parent=cls, parameters=griffe.Parameters(first, *fields), returns="None"
        )
        cls.set_member("__init__", init)
