"""Options: what can be said to a part of the program, declared once, where it is used.

Every class of options is checked when it is made, from Python as from a configuration: same values, same object. A
field is declared with its type, range, default, unit and a sentence:

    tolerance: Annotated[float, Field(gt=0, description="Relative error of the forces.")] = 0.035

`settings/` composes these classes into the sections of a configuration; the reference page, the editor's schema and
the messages about a wrong value come from the declarations.
"""

from __future__ import annotations

from typing import Annotated, Any, Self

import yaml
from pydantic import BaseModel, ConfigDict
from pydantic import Field as Field
from pydantic import model_validator as model_validator

Vector = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0)]
Seed = Annotated[int, Field(ge=0)]


class Options(BaseModel):
    """Some options that belong together: frozen, unknown names and values that are not finite refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    def replace(self, **changes: Any) -> Self:
        """The same with other values for some, checked as if it were made anew."""
        given = {name: getattr(self, name) for name in self.model_fields_set}
        return type(self)(**given | changes)

    def dump(self, defaults: bool = True) -> str:
        """As YAML, with the defaults or with what was given alone; the same text for the same values."""
        content = self.model_dump(mode="json", exclude_unset=not defaults)
        text: str = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=120)
        return text
